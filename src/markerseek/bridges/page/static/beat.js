// Says so when the page has had no news for a second. Commands carry the number of the last beat that was seen, so that
// the server refuses those of a page that shows old things. STOP goes two ways of its own, and one is enough: by a line
// that is open already, for a page that many connect to, and by a plain request.

const SILENT_MS = 1000;
// From then on nothing that the page shows is taken for the present.
const DEAD_S = 4;
// A page that hangs takes a request and never answers it.
const STOP_MS = 1000;
const WHY = { TimeoutError: "no answer within 1 s", TypeError: "nothing answers" };
// A line that broke is opened again.
const AGAIN_MS = 2000;

export default {
  template: `<div v-show="silent_s > 0 || undelivered" class="ms-silent" role="alert">
    <span v-if="undelivered">STOP was not delivered ({{ undelivered }}): press Ctrl-C in the terminal of the page. </span>
    <span v-if="dead">The program of this page does not answer: look at the terminal where it was started.</span>
    <span v-else-if="silent_s > 0">No news for {{ silent_s }} s: what you see is old, and only STOP is sent.</span></div>`,
  props: { beat: Number },
  data: () => ({ silent_s: 0, undelivered: "" }),
  computed: {
    dead() {
      return this.silent_s >= DEAD_S;
    },
  },
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
    window.markerseekStop = () => this.stop();
    document.addEventListener("keydown", this.key);
    // Once Vue has set the prefix of the page.
    setTimeout(() => this.open());
  },
  unmounted() {
    this.over = true;
    this.line?.close();
    clearInterval(this.every);
    document.removeEventListener("keydown", this.key);
  },
  methods: {
    look() {
      const silent_ms = performance.now() - this.last;
      this.silent_s = silent_ms > SILENT_MS ? Math.round(silent_ms / 1000) : 0;
      document.body.classList.toggle("ms-stale", this.silent_s > 0);
      document.body.classList.toggle("ms-dead", this.dead);
    },
    open() {
      if (this.over) return;
      this.line = new WebSocket(`${location.origin.replace(/^http/, "ws")}${window.path_prefix}/stop`);
      this.line.onclose = () => setTimeout(() => this.open(), AGAIN_MS);
    },
    async stop() {
      const ways = [this.stopByRequest(), this.stopByLine()];
      const problem = await Promise.any(ways).then(() => null, (all) => all.errors[0]);
      this.undelivered = problem === null ? "" : (WHY[problem.name] ?? problem.message);
    },
    async stopByRequest() {
      const signal = AbortSignal.timeout(STOP_MS);
      const answer = await fetch(`${window.path_prefix}/stop`, { method: "POST", keepalive: true, signal });
      if (!answer.ok) throw new Error(`refused with status ${answer.status}`);
    },
    async stopByLine() {
      if (this.line?.readyState !== WebSocket.OPEN) throw new Error("the line is not open");
      this.line.send("stop");
      await new Promise((resolve, reject) => {
        this.line.onmessage = resolve;
        setTimeout(reject, STOP_MS);
      });
    },
    key(event) {
      // Escape stops, wherever the focus is; held down, it stops once.
      if (event.key === "Escape" && !event.repeat) window.markerseekStop();
    },
  },
};
