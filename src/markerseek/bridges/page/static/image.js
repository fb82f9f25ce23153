// The photoacoustic image: levels in decibels as colour over a grey background, depth downwards. Each is placed by its
// own edges in millimetres of the array.

export default {
  template: `<canvas class="ms-canvas" role="img" :aria-label="said"></canvas>`,
  props: { view: Object, background: Object },
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
  },
  unmounted() {
    this.seen.disconnect();
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
      c.fillStyle = "#000";
      c.fillRect(0, 0, width, height);
      c.font = "12px system-ui, sans-serif";
      c.fillStyle = "#cfd4da";
      const v = this.view;
      if (!v.pixels) {
        c.textAlign = "center";
        c.fillText(v.why, width / 2, height / 2);
        return;
      }
      const layers = [v];
      if (this.background.pixels) layers.unshift(this.background);
      const lateral = hull(layers.map((each) => each.lateral_mm));
      const depth = hull(layers.map((each) => each.depth_mm));
      const [across, down] = [lateral[1] - lateral[0], depth[1] - depth[0]];
      const mm = Math.min((width - 8) / across, (height - 34) / down);
      const x = (at) => (width - across * mm) / 2 + (at - lateral[0]) * mm;
      const y = (at) => 16 + (at - depth[0]) * mm;
      for (const each of layers) {
        const [[left, right], [top, bottom]] = [each.lateral_mm, each.depth_mm];
        const picture = painted(each, each === v ? hot : grey);
        c.drawImage(picture, x(left), y(top), (right - left) * mm, (bottom - top) * mm);
      }
      if (v.peak) {
        c.strokeStyle = "#56b4e9";
        c.lineWidth = 2;
        c.beginPath();
        c.arc(x(v.peak[0]), y(v.peak[1]), 9, 0, 2 * Math.PI);
        c.stroke();
      }
      c.textAlign = "left";
      c.fillText(`${v.deg.toFixed(2)}°, lateral ${lateral[0].toFixed(0)} to ${lateral[1].toFixed(0)} mm`, 6, 12);
      c.fillText(`depth ${depth[0].toFixed(0)} to ${depth[1].toFixed(0)} mm, ${v.range} dB`, 6, height - 6);
    },
  },
};

const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

const hull = (spans) => [Math.min(...spans.map((each) => each[0])), Math.max(...spans.map((each) => each[1]))];

// Colours of a level from 0 to 1, each from 0 to 1: black-body colours are transparent where the level is low.
const grey = (level) => [level, level, level, 1];
const hot = (level) => [level * 2.2, level * 2 - 0.6, level * 3 - 2, level * 1.6];

function painted(layer, colour) {
  const image = new ImageData(layer.columns, layer.rows);
  // An array of this type clamps to 0 and 255 by itself.
  bytes(layer.pixels).forEach((level, i) => image.data.set(colour(level / 255).map((each) => 255 * each), 4 * i));
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [layer.columns, layer.rows];
  canvas.getContext("2d").putImageData(image, 0, 0);
  return canvas;
}
