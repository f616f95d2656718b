// The thumbnails of many photographs, of which only those in view are loaded; a click removes a photograph.
export default {
  template: `
    <ul class="photographs tiles" aria-label="Photographs loaded">
      <li v-for="(photograph, index) in photographs" :key="photograph.address">
        <button type="button" class="tile" :class="{'with-problem': problems[photograph.name]}" :title="words(photograph.name)"
          :aria-label="words(photograph.name)" @click="$emit('remove', photograph.name)">
          <img v-if="index < ready" :src="photograph.address" alt="" loading="lazy">
          <span v-else class="pending"></span>
        </button>
      </li>
    </ul>`,
  props: { photographs: Array, problems: Object, read: Number },
  data() {
    return { ready: this.read };
  },
  methods: {
    words(name) {
      return "Remove " + name + (this.problems[name] ? " (" + this.problems[name] + ")" : "");
    },
    show(ready) {
      this.ready = ready;
    },
  },
};
