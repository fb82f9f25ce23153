// The photoacoustic image: levels in decibels as colour over a grey background, depth downwards.

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
      const [across, down] = [v.lateral[1] - v.lateral[0], v.depth[1] - v.depth[0]];
      const mm = Math.min((width - 8) / across, (height - 34) / down);
      const box = { x: (width - across * mm) / 2, y: 16, w: across * mm, h: down * mm };
      c.drawImage(painted(v, this.background), box.x, box.y, box.w, box.h);
      if (v.peak) {
        const [x, y] = [box.x + (v.peak[0] - v.lateral[0]) * mm, box.y + (v.peak[1] - v.depth[0]) * mm];
        c.strokeStyle = "#56b4e9";
        c.lineWidth = 2;
        c.beginPath();
        c.arc(x, y, 9, 0, 2 * Math.PI);
        c.stroke();
      }
      c.textAlign = "left";
      c.fillText(`${v.deg.toFixed(2)}°, lateral ${v.lateral[0].toFixed(0)} to ${v.lateral[1].toFixed(0)} mm`, 6, 12);
      c.fillText(`depth ${v.depth[0].toFixed(0)} to ${v.depth[1].toFixed(0)} mm, ${v.range} dB`, 6, height - 6);
    },
  },
};

const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

// Levels 0 to 255 become black-body colours; where they are low, the background shows.
function painted(view, background) {
  const pixels = bytes(view.pixels);
  const under = background && background.pixels ? bytes(background.pixels) : null;
  const image = new ImageData(view.columns, view.rows);
  for (let i = 0; i < pixels.length; i++) {
    const level = pixels[i] / 255;
    const grey = under ? under[i % under.length] * 0.55 : 0;
    const opaque = Math.min(1, level * 1.6);
    image.data[4 * i] = grey * (1 - opaque) + 255 * Math.min(1, level * 2.2) * opaque;
    image.data[4 * i + 1] = grey * (1 - opaque) + 255 * Math.min(1, Math.max(0, level * 2 - 0.6)) * opaque;
    image.data[4 * i + 2] = grey * (1 - opaque) + 255 * Math.max(0, level * 3 - 2) * opaque;
    image.data[4 * i + 3] = 255;
  }
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [view.columns, view.rows];
  canvas.getContext("2d").putImageData(image, 0, 0);
  return canvas;
}
