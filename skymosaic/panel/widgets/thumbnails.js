// The thumbnails of many photographs, of which only those in view are loaded; a click removes a photograph.
export default {
  template: `
    <ul class="photographs tiles" aria-label="Photographs loaded">
      <li v-for="(photograph, index) in photographs" :key="photograph.address">
        <button type="button" class="tile" :class="{'with-problem': photograph.problem}" :title="words(photograph)"
          :aria-label="words(photograph)" @click="$emit('remove', photograph.name)">
          <img v-if="index < ready" :src="photograph.address" alt="" loading="lazy">
          <span v-else class="pending"></span>
        </button>
      </li>
    </ul>`,
  props: { photographs: Array, read: Number },
  data() {
    return { ready: this.read };
  },
  methods: {
    words(photograph) {
      return "Remove " + photograph.name + (photograph.problem ? " (" + photograph.problem + ")" : "");
    },
    show(ready) {
      this.ready = ready;
    },
  },
};
