// The way to the view's server. A picture that stands still must never look alive: silence counts as loss.

const SILENT_MS = 1500; // a state comes every 200 ms
const RETRY_MS = 1000;
const CHECK_MS = 100;
const TOO_MANY = 1013; // the server's close code where as many pages are open as it serves

export class Connection {
  // heard(message) for every message; changed(status, silent_ms) at every check, status one of "connecting", "open", "lost", "refused", "full"
  constructor(heard, changed) {
    this.token = new URLSearchParams(location.search).get("token") ?? "";
    this.status = "connecting";
    this.heard = heard;
    this.changed = changed;
    this.lastHeardMs = performance.now();
    this.open();
    setInterval(() => this.check(), CHECK_MS);
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/stream?token=${encodeURIComponent(this.token)}`);
    socket.onmessage = (event) => this.take(event);
    socket.onclose = (event) => this.closed(event.code);
    this.socket = socket;
  }

  take(event) {
    this.lastHeardMs = performance.now();
    this.status = "open";
    this.heard(JSON.parse(event.data));
  }

  async closed(code) {
    this.status = code === TOO_MANY ? "full" : (await this.isRefused()) ? "refused" : "lost";
    setTimeout(() => this.open(), RETRY_MS);
  }

  // a browser does not tell why a socket would not open, a plain request does
  async isRefused() {
    try {
      const answer = await fetch(this.address(""), { method: "HEAD", cache: "no-store" });
      return answer.status === 401 || answer.status === 403;
    } catch {
      return false;
    }
  }

  check() {
    const silentMs = performance.now() - this.lastHeardMs;
    if (this.status === "open" && silentMs > SILENT_MS) this.status = "lost";
    this.changed(this.status, silentMs);
  }

  send(message) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  address(path) {
    return `/${path}?token=${encodeURIComponent(this.token)}`;
  }
}
