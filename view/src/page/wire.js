// The connection to the program: frames in, acknowledgements and requests out, and a new try whenever it breaks.
// The format is documented in the program's source (view/wire.rs).

const VERSION = 5;
const NO_ID = 0xffffffff;
const text = new TextDecoder();

/** Reads a frame; null if the bytes are not one of this version. Its `news` are for Cells. */
export function decode(buffer) {
  const view = new DataView(buffer);
  if (buffer.byteLength < 92 || view.getUint32(0) !== 0x534b4e30 + VERSION) return null;
  const [n, m, s] = [view.getUint32(80, true), view.getUint16(84, true), view.getUint16(86, true)];
  const touchesAt = 92 + n;
  const statusAt = touchesAt + 28 * m;
  if (buffer.byteLength !== statusAt + s) return null;
  const touches = [];
  for (let k = 0, at = touchesAt; k < m; k++, at += 28) {
    const id = view.getUint32(at, true);
    const [x, y, rise, area, force] = [4, 8, 12, 16, 20].map((offset) => view.getFloat32(at + offset, true));
    touches.push({ id: id === NO_ID ? null : id, x, y, rise, area, force: Number.isNaN(force) ? null : force,
      atLimit: view.getUint32(at + 24, true) !== 0 });
  }
  return {
    scene: view.getUint32(4, true),
    sequence: Number(view.getBigUint64(8, true)),
    time: view.getFloat64(16, true),
    published: view.getFloat64(24, true),
    rate: view.getFloat32(32, true),
    solve: view.getFloat32(36, true),
    residual: view.getFloat32(40, true),
    full: view.getFloat32(44, true),
    smoothed: view.getUint32(88, true) !== 0,
    lost: Number(view.getBigUint64(48, true)),
    skipped: Number(view.getBigUint64(56, true)),
    number: Number(view.getBigUint64(64, true)),
    base: Number(view.getBigUint64(72, true)),
    news: new Uint8Array(buffer, 92, n),
    touches: touches.sort((a, b) => b.rise - a.rise),
    status: text.decode(new Uint8Array(buffer, statusAt, s)),
  };
}

/** The cells of a scene, put together from what its frames tell. */
export class Cells {
  constructor(count) {
    this.number = 0;
    this.steps = new Uint16Array(count);
    this.changed = new Set();
  }

  /** Takes a frame; false if it builds on another picture than this. */
  apply(frame) {
    if (frame.base !== this.number) return false;
    const { news } = frame;
    let k = 0;
    // Groups of seven bits, the lowest first.
    const number = () => {
      let value = 0;
      for (let shift = 0; ; shift += 7) {
        const byte = news[k++];
        value |= (byte & 0x7f) << shift;
        if (byte < 0x80 || shift > 21) return value;
      }
    };
    for (let at = 0; k < news.length; ) {
      at += number();
      for (let count = number(); count > 0; count--, at++) {
        const step = number();
        if (this.steps[at] === step) continue;
        this.steps[at] = step;
        this.changed.add(at);
      }
    }
    this.number = frame.number;
    return true;
  }

  /** The cells that changed since they were asked for last. */
  news() {
    const news = [...this.changed];
    this.changed.clear();
    return news;
  }
}

/**
 * Keeps a connection to the program.
 * `on.state("live" | "wait" | "lost", seconds to the next try)`, `on.scene(scene)`, `on.frame(frame)`, `on.rights(whether this page may
 * command)`, `on.recording(what is recorded)`, `on.replay(where the recording is that is played)`, `on.guide(where to press next)`; the cells are in
 * `cells`.
 */
export class Connection {
  constructor(on) {
    this.on = on;
    this.tries = 0;
    this.clocks = [];
    this.socket = null;
    this.scene = 0;
    this.cells = new Cells(0);
  }

  /** Connects, and keeps connecting from then on. */
  start() {
    setInterval(() => this.askTime(), 2000);
    // The address that was printed, put into a page that is open already.
    addEventListener("hashchange", () => this.enter());
    // Who may command one skin may command all.
    for (const link of document.querySelectorAll("#skins a")) {
      link.addEventListener("click", () => { link.hash = location.hash; });
    }
    this.open();
  }

  open() {
    this.on.state("wait", 0);
    const url = new URL("live", location.href);
    url.protocol = "ws:";
    const socket = new WebSocket(url);
    this.socket = socket;
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.tries = 0;
      this.clocks = [];
      this.on.state("live", 0);
      this.enter();
      this.askTime();
    };
    socket.onmessage = (event) => this.take(event.data);
    socket.onclose = () => this.retry();
  }

  retry() {
    const seconds = Math.min(0.5 * 2 ** this.tries++, 4);
    this.on.state("lost", seconds);
    setTimeout(() => this.open(), 1000 * seconds);
  }

  take(data) {
    if (typeof data !== "string") {
      // Acknowledged at once, not when it is drawn: the next one may travel meanwhile.
      this.socket.send(new Uint8Array([1]));
      const frame = decode(data);
      if (!frame || frame.scene !== this.scene) return;
      // Something is missing: a new connection begins with everything.
      if (!this.cells.apply(frame)) return void this.socket.close();
      this.on.frame(frame);
      return;
    }
    const message = JSON.parse(data);
    if (message.kind === "scene") {
      // The program was replaced by another version: fetch its page.
      if (message.version !== VERSION) location.reload();
      this.scene = message.scene;
      this.cells = new Cells(message.cells.length);
      this.on.scene(message);
    } else if (message.kind === "rights") {
      // In place of a ticket, which is good only once, the address keeps the token: the page may be loaded again.
      if (message.token) history.replaceState(null, "", `#${message.token}`);
      this.on.rights(message.token !== null);
    } else if (message.kind === "recording") {
      this.on.recording(message);
    } else if (message.kind === "guide") {
      this.on.guide(message);
    } else if (message.kind === "replay") {
      this.on.replay(message);
    } else if (message.kind === "clock") {
      const now = performance.now();
      const trip = now - message.page_ms;
      this.clocks.push({ trip, offset: message.server_ms + trip / 2 - now });
      this.clocks = this.clocks.slice(-8);
    }
  }

  /** Shows what the address ends with, to be allowed to command. */
  enter() {
    this.send({ kind: "enter", key: location.hash.slice(1, 65) });
  }

  askTime() {
    if (!document.hidden) this.send({ kind: "clock", page_ms: performance.now() });
  }

  /** Asks for something; false if there is no connection. */
  send(request) {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(request));
    return true;
  }

  /** Age of a frame now, ms; not-a-number until the clocks are compared. */
  age(frame) {
    if (!this.clocks.length) return NaN;
    const best = this.clocks.reduce((a, b) => (b.trip < a.trip ? b : a));
    return Math.max(0, performance.now() + best.offset - frame.published);
  }
}
