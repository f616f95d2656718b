// Membership curves with corners to drag; a corner is a slider, so that keys move it and screen readers name it.
const WIDTH = 240, HEIGHT = 86, LEFT = 14, RIGHT = 10, TOP = 18, BOTTOM = 16;
const ACROSS = WIDTH - LEFT - RIGHT, UP = HEIGHT - TOP - BOTTOM;
const STEPS = 200;
const INTERVAL_MS = 50;

export default {
  template: `
    <svg class="curves-plot" ref="svg" viewBox="0 0 ${WIDTH} ${HEIGHT}" role="group" :aria-label="label">
      <line class="axis" :x1="x(0)" :x2="x(high)" :y1="y(0)" :y2="y(0)" />
      <text class="axis-name" :x="x(0)" y="${HEIGHT - 2}" text-anchor="middle">0</text>
      <text class="axis-name" :x="x(high)" y="${HEIGHT - 2}" text-anchor="middle">{{ high }}</text>
      <polyline v-for="([name, points], n) in curves" :key="name" class="set" :class="kind(n)"
        transform="translate(${LEFT} ${HEIGHT - BOTTOM}) scale(${ACROSS} ${-UP})" vector-effect="non-scaling-stroke"
        :points="points" />
      <text v-for="([name, points], n) in curves" :key="'name of ' + name" class="set-name" :class="kind(n)"
        :x="peak(points)" y="10" text-anchor="middle" aria-hidden="true">{{ name }}</text>
      <circle v-for="([at, degree, name], n) in corners" :key="n" class="corner" r="5" tabindex="0" role="slider"
        :cx="x(held === n ? place[0] : at)" :cy="y(held === n ? place[1] : degree)" :aria-label="name"
        aria-valuemin="0" :aria-valuemax="high" :aria-valuenow="at"
        @pointerdown.prevent="take(n, $event)" @pointermove="drag($event)" @pointerup="drop" @pointercancel="drop"
        @keydown="key(n, $event)" @keyup="drop" @blur="drop" />
    </svg>`,
  props: { label: String, high: Number, curves: Array, corners: Array },
  data() {
    // A corner is "taken", "moved" and "dropped"; then it stays where it was put until its rules are shown.
    return { held: -1, state: "", place: [0, 0], timer: null };
  },
  methods: {
    x(value) { return LEFT + ACROSS * value / this.high; },
    y(degree) { return TOP + UP * (1 - degree); },
    // The middle of where a curve is highest.
    peak(points) {
      const places = points.split(" ").map((point) => point.split(",").map(Number));
      const top = Math.max(...places.map(([, degree]) => degree));
      const highest = places.filter(([, degree]) => degree === top);
      return LEFT + ACROSS * (highest[0][0] + highest.at(-1)[0]) / 2;
    },
    kind(n) { return ["first", "second", "third"][n % 3]; },
    hold(n) {
      if (this.held !== n) this.place = this.corners[n].slice(0, 2);
      this.held = n;
    },
    move(at, degree) {
      this.state = "moved";
      this.place = [Math.min(Math.max(at, 0), this.high), Math.min(Math.max(degree, 0), 1)];
      this.timer ??= setTimeout(() => this.tell("move"), INTERVAL_MS);
    },
    tell(event) {
      clearTimeout(this.timer);
      this.timer = null;
      this.$emit(event, [this.held, ...this.place]);
    },
    take(n, event) {
      this.hold(n);
      this.state = "taken";
      event.target.focus();
      event.target.setPointerCapture(event.pointerId);
    },
    drag(event) {
      if (!["taken", "moved"].includes(this.state)) return;
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.$refs.svg.getScreenCTM().inverse());
      this.move((at.x - LEFT) / ACROSS * this.high, 1 - (at.y - TOP) / UP);
    },
    key(n, event) {
      const step = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
      if (!step) return;
      event.preventDefault();
      this.hold(n);
      this.move(this.place[0] + step[0] * this.high / STEPS, this.place[1] + step[1] / 100);
    },
    drop() {
      if (this.state === "moved") this.tell("drop");
      this.state = this.state === "moved" ? "dropped" : "";
    },
    release() {
      if (["taken", "moved"].includes(this.state)) return;
      this.held = -1;
      this.state = "";
    },
  },
};
