// The photoacoustic image: levels in decibels as colour, depth downwards, placed by its edges in millimetres of the array.

// Room for the ticks, and for their text: depth at the left, lateral position below.
const [LEFT, RIGHT, TOP, BOTTOM] = [44, 8, 8, 40];

export default {
  template: `<canvas class="ms-canvas" role="img" :aria-label="said"></canvas>`,
  props: { view: Object },
  computed: {
    said() {
      return this.view.pixels ? `photoacoustic image at ${this.view.deg.toFixed(2)} degrees` : "no image yet";
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
      canvas.width = Math.round(width * scale);
      canvas.height = Math.round(height * scale);
      const c = canvas.getContext("2d");
      c.setTransform(scale, 0, 0, scale, 0, 0);
      c.font = "13px system-ui, sans-serif";
      c.fillStyle = c.strokeStyle = getComputedStyle(canvas).color;
      const v = this.view;
      if (!v.pixels) {
        c.textAlign = "center";
        c.fillText("no image yet", width / 2, height / 2);
        return;
      }
      const [lateral, depth] = [v.lateral_mm, v.depth_mm];
      const [across, down] = [lateral[1] - lateral[0], depth[1] - depth[0]];
      const mm = Math.min((width - LEFT - RIGHT) / across, (height - TOP - BOTTOM) / down);
      const left = LEFT + (width - LEFT - RIGHT - across * mm) / 2;
      const x = (at) => left + (at - lateral[0]) * mm;
      const top = TOP;
      const y = (at) => top + (at - depth[0]) * mm;
      ticks(c, { lateral, depth, mm, x, y });
      c.fillStyle = "#000";
      c.fillRect(x(lateral[0]), y(depth[0]), across * mm, down * mm);
      c.drawImage(painted(v), x(lateral[0]), y(depth[0]), across * mm, down * mm);
      if (v.peak) {
        c.strokeStyle = "#56b4e9";
        c.lineWidth = 2;
        c.beginPath();
        c.arc(x(v.peak[0]), y(v.peak[1]), 9, 0, 2 * Math.PI);
        c.stroke();
      }
      // The scale bar, in a corner of the image that is rarely bright.
      c.fillStyle = "#fff";
      c.textAlign = "right";
      c.fillRect(x(lateral[1]) - 8 - BAR_MM * mm, y(depth[1]) - 12, BAR_MM * mm, 3);
      c.fillText(`${BAR_MM} mm`, x(lateral[1]) - 8, y(depth[1]) - 17);
    },
  },
};

const BAR_MM = 10;

// Ticks of both axes in millimetres, as many as there is room for.
function ticks(c, { lateral, depth, mm, x, y }) {
  const step = [5, 10, 20, 50].find((each) => each * mm > 34) ?? 100;
  const inside = (ends) => {
    const first = Math.ceil(ends[0] / step);
    return Array.from({ length: Math.max(0, Math.floor(ends[1] / step) - first + 1) }, (_, i) => (first + i) * step);
  };
  const [left, bottom] = [x(lateral[0]), y(depth[1])];
  c.textAlign = "center";
  for (const at of inside(lateral)) {
    c.fillRect(x(at) - 0.5, bottom, 1, 5);
    c.fillText(`${at}`.replace("-", "\u2212"), x(at), bottom + 18);
  }
  c.fillText("lateral [mm]", (left + x(lateral[1])) / 2, bottom + 34);
  c.textAlign = "right";
  for (const at of inside(depth)) {
    c.fillRect(left - 5, y(at) - 0.5, 5, 1);
    c.fillText(`${at}`, left - 8, y(at) + 4);
  }
  c.save();
  c.translate(left - 30, (y(depth[0]) + bottom) / 2);
  c.rotate(-Math.PI / 2);
  c.textAlign = "center";
  c.fillText("depth [mm]", 0, 0);
  c.restore();
}

const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

// Colours of a level from 0 to 1, each from 0 to 1: black-body colours, transparent where the level is low.
const hot = (level) => [level * 2.2, level * 2 - 0.6, level * 3 - 2, level * 1.6];

function painted(layer) {
  const image = new ImageData(layer.columns, layer.rows);
  // An array of this type clamps to 0 and 255 by itself.
  bytes(layer.pixels).forEach((level, i) => image.data.set(hot(level / 255).map((each) => 255 * each), 4 * i));
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [layer.columns, layer.rows];
  canvas.getContext("2d").putImageData(image, 0, 0);
  return canvas;
}
