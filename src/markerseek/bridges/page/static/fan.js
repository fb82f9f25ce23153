// The probe seen from its end: limits, where the marker probably is, where the probe was, is, and goes.
// While the stage moves the needle is dashed, at the angle to which it was sent: expected, not measured.

// Radius of the probe over that of the fan, as drawn.
const FACE = 0.28;

const COLOUR = {
  light: { ink: "#22272e", quiet: "#5b636e", fan: "#eef1f4", glow: [0, 114, 178], answer: "#b34700", truth: "#00735a" },
  dark: { ink: "#e8ebef", quiet: "#a3abb6", fan: "#20262e", glow: [86, 180, 233], answer: "#ff9a4d", truth: "#2fc39b" },
};

export default {
  template: `<canvas class="ms-canvas" role="img" :aria-label="view.text" tabindex="-1"></canvas>`,
  props: { view: Object },
  computed: {
    curve() {
      return this.view.curve;
    },
  },
  watch: {
    view() {
      this.draw();
    },
  },
  mounted() {
    this.seen = new ResizeObserver(() => this.draw());
    this.seen.observe(this.$el);
    this.theme = new MutationObserver(() => this.draw());
    this.theme.observe(document.body, { attributes: true, attributeFilter: ["class"] });
  },
  unmounted() {
    this.seen.disconnect();
    this.theme.disconnect();
  },
  methods: {
    draw() {
      const canvas = this.$el;
      const scale = window.devicePixelRatio || 1;
      const [width, height] = [canvas.clientWidth, canvas.clientHeight];
      if (!width || !height) return;
      if (canvas.width !== Math.round(width * scale)) canvas.width = Math.round(width * scale);
      if (canvas.height !== Math.round(height * scale)) canvas.height = Math.round(height * scale);
      const c = canvas.getContext("2d");
      c.setTransform(scale, 0, 0, scale, 0, 0);
      c.clearRect(0, 0, width, height);
      c.font = "14px system-ui, sans-serif";
      c.textAlign = "center";
      const colour = document.body.classList.contains("body--dark") ? COLOUR.dark : COLOUR.light;
      const { low_deg, high_deg, bracket, interval, answers, others, known, is_claimed } = this.curve;
      const half = rad(Math.max(Math.abs(low_deg), Math.abs(high_deg), 10));
      // Room for the text below the probe, and for the number at the end of the range.
      const widest = Math.sin(Math.min(half, Math.PI / 2));
      const far = Math.min(height - 62, (width / 2 - 18) / widest - outside(half));
      // While panels are laid out anew there may be no room at all.
      if (far <= 0) return;
      // In the middle of a panel that is higher than the fan.
      const g = { x: width / 2, y: (height + far) / 2 + 1, near: far * FACE, far };
      const wedge = (from, to, near, away) => {
        c.beginPath();
        c.arc(g.x, g.y, away, turn(from), turn(to));
        c.arc(g.x, g.y, near, turn(to), turn(from), true);
        c.closePath();
      };
      const ray = (deg, near, away) => {
        c.beginPath();
        c.moveTo(g.x + near * Math.sin(rad(deg)), g.y - near * Math.cos(rad(deg)));
        c.lineTo(g.x + away * Math.sin(rad(deg)), g.y - away * Math.cos(rad(deg)));
        c.stroke();
      };
      wedge(low_deg, high_deg, g.near, g.far);
      c.fillStyle = colour.fan;
      c.fill();
      this.glow(c, wedge, g, colour);
      this.scale(c, g, colour, ray);
      const numbered = this.points(c, g, colour);
      if (bracket) this.span(c, wedge, bracket, g.far + 3, g.far + 7, colour.answer);
      if (interval) this.span(c, wedge, interval, g.far + 9, g.far + 13, colour.answer);
      c.lineWidth = 2;
      c.strokeStyle = colour.answer;
      c.setLineDash(is_claimed ? [] : [8, 4]);
      for (const answer of answers) ray(answer.angle_deg, g.near, g.far + 14);
      c.strokeStyle = colour.quiet;
      c.fillStyle = colour.quiet;
      c.setLineDash([5, 4]);
      for (const other of others) {
        ray(other.angle_deg, g.near, g.far + 8);
        label(c, g, other.angle_deg, g.far - 10, "?");
      }
      if (known) {
        c.strokeStyle = colour.truth;
        c.setLineDash([2, 4]);
        ray(known.angle_deg, g.near, g.far + 14);
      }
      c.setLineDash([]);
      this.probe(c, g, colour, ray);
      this.numbers(c, numbered, colour);
    },
    glow(c, wedge, g, colour) {
      const { low_deg, high_deg, density_deg: angles, density_per_deg: density } = this.curve;
      const most = Math.max(...density, 0);
      if (!(most > 0)) return;
      const [r, green, b] = colour.glow;
      // The glow grows with what is known: faint while the marker may be anywhere, strong once its degree is known.
      const strength = 0.25 + 0.6 * this.view.certainty;
      const inside = (deg) => Math.min(Math.max(deg, low_deg), high_deg);
      for (let i = 0; i < angles.length; i++) {
        const share = Math.sqrt(density[i] / most);
        if (share < 0.02) continue;
        const low = inside(i ? (angles[i - 1] + angles[i]) / 2 : angles[i]);
        const high = inside(i + 1 < angles.length ? (angles[i] + angles[i + 1]) / 2 : angles[i]);
        // The posterior reaches beyond the limits; the fan does not.
        if (!(high > low)) continue;
        c.fillStyle = `rgba(${r},${green},${b},${strength * share})`;
        wedge(low, high, g.near, g.near + (g.far - g.near) * share);
        c.fill();
      }
      // A halo, so that a posterior sharper than the needle stays visible on both sides of it.
      const sharpest = angles[density.indexOf(most)];
      for (const room of this.view.certainty > 0.5 ? [2.2, 1.3, 0.6] : []) {
        c.fillStyle = `rgba(${r},${green},${b},0.16)`;
        wedge(inside(sharpest - room), inside(sharpest + room), g.near, g.far);
        c.fill();
      }
    },
    scale(c, g, colour, ray) {
      const { low_deg, high_deg } = this.curve;
      c.strokeStyle = colour.quiet;
      c.fillStyle = colour.quiet;
      c.lineWidth = 1;
      for (let deg = Math.ceil(low_deg / 5) * 5; deg <= high_deg; deg += 5) {
        ray(deg, g.far, g.far + (deg % 10 ? 3 : 6));
        if (deg % (g.far < 215 ? 20 : 10) === 0) label(c, g, deg, g.far + outside(rad(deg)), `${deg}°`.replace("-", "\u2212"));
      }
      c.lineWidth = 2;
      ray(low_deg, g.near, g.far + 6);
      ray(high_deg, g.near, g.far + 6);
      // Where a next acquisition was weighed up: the longer the tick, the better.
      c.lineWidth = 1.5;
      for (const [deg, share] of this.view.choices) ray(deg, g.far - 14 * share, g.far);
    },
    points(c, g, colour) {
      const { marks } = this.curve;
      const strongest = marks.reduce((most, mark) => Math.max(most, mark.intensity), 0) || 1;
      const numbered = [];
      marks.forEach((mark, i) => {
        const newest = i === marks.length - 1;
        const away = g.near + (g.far - g.near) * (0.12 + (0.8 * mark.intensity) / strongest);
        const [x, y] = [g.x + away * Math.sin(rad(mark.angle_deg)), g.y - away * Math.cos(rad(mark.angle_deg))];
        c.beginPath();
        if (mark.role === "confirmation") c.rect(x - 4, y - 4, 8, 8);
        else c.arc(x, y, newest ? 4.5 : 3, 0, 2 * Math.PI);
        c.fillStyle = colour.ink;
        c.fill();
        if (mark.text) numbered.push([x, y - 7, mark.text]);
      });
      return numbered;
    },
    // Last of all and on a ground of their own, so that no line crosses them.
    numbers(c, numbered, colour) {
      c.lineWidth = 3;
      c.lineJoin = "round";
      c.strokeStyle = colour.fan;
      c.fillStyle = colour.ink;
      // The newest first; a number that would cover another one is left out.
      const drawn = [];
      for (const [x, y, text] of numbered.reverse()) {
        if (drawn.some(([u, w]) => Math.abs(u - x) < 17 && Math.abs(w - y) < 14)) continue;
        drawn.push([x, y]);
        c.strokeText(text, x, y);
        c.fillText(text, x, y);
      }
    },
    span(c, wedge, interval, near, away, fill) {
      const { low_deg, high_deg } = this.curve;
      // At least a quarter of a degree wide, so that a narrow interval is seen.
      const room = Math.max(0, 0.25 - (interval.high_deg - interval.low_deg)) / 2;
      wedge(Math.max(interval.low_deg - room, low_deg - 1), Math.min(interval.high_deg + room, high_deg + 1), near, away);
      c.fillStyle = fill;
      c.fill();
    },
    probe(c, g, colour, ray) {
      const v = this.view;
      const deg = v.target_deg ?? v.probe_deg;
      // The half that looks at the tissue: below it stands where the probe is.
      c.beginPath();
      c.arc(g.x, g.y, g.near * 0.96, turn(-90), turn(90));
      c.closePath();
      c.fillStyle = colour.fan;
      c.fill();
      c.strokeStyle = colour.quiet;
      c.lineWidth = 1.5;
      c.stroke();
      if (deg === null) return;
      c.strokeStyle = colour.ink;
      c.lineWidth = 5;
      // The array's face: a chord of the probe, square to the needle.
      c.beginPath();
      c.arc(g.x, g.y, g.near * 0.96, turn(deg - 24), turn(deg + 24));
      c.stroke();
      c.lineWidth = 2;
      if (v.target_deg !== null) c.setLineDash([6, 5]);
      ray(deg, g.near, g.far);
      c.setLineDash([]);
      c.fillStyle = colour.ink;
      c.fillText(v.said, g.x, g.y + 22);
    },
  },
};

const rad = (deg) => (deg * Math.PI) / 180;
const turn = (deg) => rad(deg) - Math.PI / 2;
// Of a number from the fan, beyond the arc of the interval: the more it leans, the more of its width lies towards the fan.
const outside = (angle) => 21 + 16 * Math.sin(Math.min(Math.abs(angle), Math.PI / 2));
const label = (c, g, deg, away, text) =>
  c.fillText(text, g.x + away * Math.sin(rad(deg)), g.y - away * Math.cos(rad(deg)) + 4);
