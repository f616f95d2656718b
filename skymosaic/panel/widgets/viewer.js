// Pictures under an SVG drawing, with zoom and pan by wheel, drag, buttons and keys; reports the pointer's position.
const STEP = 1.35;
const LARGEST_ZOOM = 24;
const POINTER_INTERVAL_MS = 40;

export default {
  template: `
    <div class="viewer" role="group" :aria-label="label">
      <svg ref="svg" tabindex="0" role="img" :aria-label="label + '. Plus and minus zoom, arrow keys move, 0 shows all.'"
        :viewBox="box.join(' ')" :style="{aspectRatio: size.join('/')}" preserveAspectRatio="xMidYMid meet" :class="{dragging: drag && drag.moved}"
        @wheel.prevent="onWheel" @pointerdown="onDown" @pointermove="onMove" @pointerup="onUp"
        @pointerleave="onLeave" @keydown="onKey">
        <image v-for="picture in pictures" :key="picture.href" :href="picture.href" :x="picture.x" :y="picture.y"
          :width="picture.width" :height="picture.height" preserveAspectRatio="none" />
        <g ref="drawing"></g>
        <g ref="highlight"></g>
      </svg>
      <div class="viewer-tools">
        <button type="button" aria-label="Zoom in" title="Zoom in (+)" @click="zoom(STEP)">+</button>
        <button type="button" aria-label="Zoom out" title="Zoom out (−)" @click="zoom(1 / STEP)">−</button>
        <button type="button" aria-label="Show all" title="Show all (0)" @click="fit">⤢</button>
      </div>
    </div>`,
  props: { pictures: Array, size: Array, drawing: String, label: String },
  data() {
    return { STEP, box: [0, 0, ...this.size], drag: null, pointer: null, timer: 0 };
  },
  mounted() { this.$refs.drawing.innerHTML = this.drawing; },
  watch: {
    drawing(markup) { this.$refs.drawing.innerHTML = markup; },
    size(now, before) { if (String(now) !== String(before)) this.fit(); },
  },
  methods: {
    showHighlight(markup) { this.$refs.highlight.innerHTML = markup; },
    fit() { this.box = [0, 0, ...this.size]; },
    zoom(factor, x = this.box[0] + this.box[2] / 2, y = this.box[1] + this.box[3] / 2) {
      const width = Math.min(this.size[0], Math.max(this.size[0] / LARGEST_ZOOM, this.box[2] / factor));
      const scale = width / this.box[2];
      this.moveTo(x - (x - this.box[0]) * scale, y - (y - this.box[1]) * scale, scale);
    },
    moveTo(left, top, scale = 1) {
      const width = this.box[2] * scale, height = this.box[3] * scale;
      const within = (value, room) => Math.max(0, Math.min(room, value));
      this.box = [within(left, this.size[0] - width), within(top, this.size[1] - height), width, height];
    },
    at(event) {
      const matrix = this.$refs.svg.getScreenCTM();
      const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix.inverse());
      return { x: point.x, y: point.y, scale: matrix.a };
    },
    onWheel(event) {
      const { x, y } = this.at(event);
      this.zoom(event.deltaY < 0 ? STEP : 1 / STEP, x, y);
    },
    onDown(event) {
      if (event.button === 0) this.drag = { x: event.clientX, y: event.clientY, moved: false };
    },
    // At most once per interval; the position where the pointer comes to rest is always reported.
    report() {
      this.timer = 0;
      if (!this.pointer) return;
      this.$emit("hover", this.pointer);
      this.pointer = null;
      this.timer = setTimeout(this.report, POINTER_INTERVAL_MS);
    },
    onMove(event) {
      if (!this.drag) {
        this.pointer = this.at(event);
        if (!this.timer) this.report();
        return;
      }
      const dx = event.clientX - this.drag.x, dy = event.clientY - this.drag.y;
      if (!this.drag.moved && Math.hypot(dx, dy) < 4) return;
      if (!this.drag.moved) this.$refs.svg.setPointerCapture(event.pointerId);
      const { scale } = this.at(event);
      this.moveTo(this.box[0] - dx / scale, this.box[1] - dy / scale);
      this.drag = { x: event.clientX, y: event.clientY, moved: true };
    },
    onUp(event) {
      if (this.drag && !this.drag.moved) this.$emit("pick", this.at(event));
      this.drag = null;
    },
    onLeave() { if (!this.drag?.moved) this.drag = null; },
    onKey(event) {
      const step = this.box[2] / 8;
      const action = {
        "+": () => this.zoom(STEP), "=": () => this.zoom(STEP), "-": () => this.zoom(1 / STEP), "0": () => this.fit(),
        ArrowLeft: () => this.moveTo(this.box[0] - step, this.box[1]),
        ArrowRight: () => this.moveTo(this.box[0] + step, this.box[1]),
        ArrowUp: () => this.moveTo(this.box[0], this.box[1] - step),
        ArrowDown: () => this.moveTo(this.box[0], this.box[1] + step),
      }[event.key];
      if (action) { event.preventDefault(); action(); }
    },
  },
};
