// Says so when the page has had no news for a second. Commands carry the number of the last beat that was seen, so that
// the server refuses those of a page that shows old things. STOP goes its own way, by a plain request.

const SILENT_MS = 1000;

export default {
  template: `<div v-show="silent_s > 0" class="ms-silent" role="alert">
    No news for {{ silent_s }} s: what you see is old, and only STOP is sent.</div>`,
  props: { beat: Number },
  data: () => ({ silent_s: 0 }),
  watch: {
    beat(now) {
      this.last = performance.now();
      window.markerseekBeat = now;
      this.look();
    },
  },
  mounted() {
    this.last = performance.now();
    window.markerseekBeat = this.beat;
    this.every = setInterval(() => this.look(), 250);
    window.markerseekStop = () => fetch("/stop", { method: "POST", keepalive: true });
    document.addEventListener("keydown", this.key);
  },
  unmounted() {
    clearInterval(this.every);
    document.removeEventListener("keydown", this.key);
  },
  methods: {
    look() {
      const silent_ms = performance.now() - this.last;
      this.silent_s = silent_ms > SILENT_MS ? Math.round(silent_ms / 1000) : 0;
      document.body.classList.toggle("ms-stale", this.silent_s > 0);
    },
    key(event) {
      // Escape stops, wherever the focus is.
      if (event.key === "Escape") window.markerseekStop();
    },
  },
};
