// The browser's own slider. In the framework's slider, the element with the focus has neither role nor name.
export default {
  template: `<input type="range" step="1" :min="min" :max="max" v-model.number="position" :aria-label="label"
    :aria-valuetext="words" @input="$emit('move', position)">`,
  props: { min: Number, max: Number, start: Number, label: String, words: String },
  data() {
    return { position: this.start };
  },
  methods: {
    moveTo(position) { this.position = position; },
  },
};
