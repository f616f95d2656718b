// The browser's own slider: unlike the framework's, what has the focus has the role and the name.
export default {
  template: `<input type="range" step="1" :min="min" :max="max" v-model.number="position" :aria-label="label"
    :aria-valuetext="words" @input="$emit('move', position)">`,
  props: { min: Number, max: Number, start: Number, label: String, words: String },
  data() {
    return { position: this.start };
  },
  methods: {
    place(position) { this.position = position; },
  },
};
