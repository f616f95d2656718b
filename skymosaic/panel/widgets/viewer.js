// Pictures under an SVG drawing, with zoom and pan by wheel, drag, pinch, buttons and keys; reports the pointer's
// position. Ours because the lines of a match must stay sharp, and be found under the pointer, at every zoom.
const STEP = 1.35;
const LARGEST_ZOOM = 24;
const POINTER_INTERVAL_MS = 40;

export default {
  template: `
    <div class="viewer" :class="{filling}" role="group" :aria-label="label">
      <svg ref="svg" tabindex="0" role="img" :aria-label="label + '. Plus and minus zoom, arrow keys move, 0 shows all.'"
        :viewBox="box.join(' ')" preserveAspectRatio="xMidYMid meet" :class="{dragging: drag && drag.moved}"
        :style="{'--zoom': size[0] / box[2], aspectRatio: filling ? 'auto' : size.join('/')}"
        @wheel.prevent="onWheel" @pointerdown="onDown" @pointermove="onMove" @pointerup="onUp" @pointercancel="onUp"
        @pointerleave="onLeave" @keydown="onKey">
        <image v-for="picture in pictures" :key="picture.href" :href="picture.href" :x="picture.x" :y="picture.y"
          :width="picture.width" :height="picture.height" preserveAspectRatio="none" />
        <image v-for="tile in tilesInView" :key="tile.href" :href="tile.href" :x="tile.x" :y="tile.y"
          :width="tile.width" :height="tile.height" preserveAspectRatio="none" />
        <g ref="drawing"></g>
        <g ref="highlight"></g>
      </svg>
      <div class="viewer-tools">
        <button type="button" aria-label="Zoom in" title="Zoom in (+)" @click="zoom(STEP)">+</button>
        <button type="button" aria-label="Zoom out" title="Zoom out (−)" @click="zoom(1 / STEP)">−</button>
        <button type="button" aria-label="Show all" title="Show all (0)" @click="fit">⤢</button>
        <button type="button" aria-label="Fill the window" title="Fill the window (F, Escape)" :aria-pressed="filling"
          @click="filling = !filling">
          <svg viewBox="0 0 16 16" aria-hidden="true"><path d="M2 6V2h4M10 2h4v4M14 10v4h-4M6 14H2v-4" /></svg>
        </button>
      </div>
    </div>`,
  props: { pictures: Array, tiles: Array, size: Array, drawing: String, label: String },
  data() {
    return { STEP, box: [0, 0, ...this.size], drag: null, pointer: null, timer: 0, filling: false, screenWidth: 0 };
  },
  mounted() {
    // Fingers on the picture, by the browser's number; not reactive, as every move changes them.
    this.fingers = new Map();
    this.$refs.drawing.innerHTML = this.drawing;
    this.resizes = new ResizeObserver(() => (this.screenWidth = this.$refs.svg.clientWidth * devicePixelRatio));
    this.resizes.observe(this.$refs.svg);
  },
  beforeUnmount() { this.resizes.disconnect(); },
  computed: {
    // The coarsest tiles that have a pixel for each of the screen, or the finest; none where the picture has.
    tilesInView() {
      const [left, top, width, height] = this.box;
      const shown = width / this.screenWidth;
      if (!this.tiles.length || shown >= 1) return [];
      const scales = this.tiles.map((tile) => tile.scale);
      const scale = Math.max(Math.min(...scales), ...scales.filter((each) => each <= shown));
      return this.tiles.filter((tile) => tile.scale === scale && tile.x < left + width && tile.x + tile.width > left &&
        tile.y < top + height && tile.y + tile.height > top);
    },
  },
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
      this.fingers.set(event.pointerId, event);
      if (event.button === 0) this.drag = { x: event.clientX, y: event.clientY, moved: this.fingers.size > 1 };
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
      if (this.fingers.size === 2 && this.fingers.has(event.pointerId)) return this.pinch(event);
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
    // Two fingers: zoom by the change of their distance, about the point between them.
    pinch(event) {
      const distance = () => {
        const [first, second] = [...this.fingers.values()];
        return Math.hypot(first.clientX - second.clientX, first.clientY - second.clientY);
      };
      const before = distance();
      this.fingers.set(event.pointerId, event);
      const [first, second] = [...this.fingers.values()];
      const { x, y } = this.at({
        clientX: (first.clientX + second.clientX) / 2, clientY: (first.clientY + second.clientY) / 2,
      });
      if (before > 0) this.zoom(distance() / before, x, y);
    },
    onUp(event) {
      this.fingers.delete(event.pointerId);
      if (this.drag && !this.drag.moved && event.type === "pointerup") this.$emit("pick", this.at(event));
      this.drag = null;
    },
    onLeave(event) {
      this.fingers.delete(event.pointerId);
      if (!this.drag?.moved) this.drag = null;
    },
    onKey(event) {
      const step = this.box[2] / 8;
      const action = {
        "+": () => this.zoom(STEP), "=": () => this.zoom(STEP), "-": () => this.zoom(1 / STEP), "0": () => this.fit(),
        ArrowLeft: () => this.moveTo(this.box[0] - step, this.box[1]),
        ArrowRight: () => this.moveTo(this.box[0] + step, this.box[1]),
        ArrowUp: () => this.moveTo(this.box[0], this.box[1] - step),
        ArrowDown: () => this.moveTo(this.box[0], this.box[1] + step),
        f: () => (this.filling = !this.filling), Escape: () => (this.filling = false),
      }[event.key];
      if (action) { event.preventDefault(); action(); }
    },
  },
};
