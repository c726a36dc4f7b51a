// The way to the view's server. A picture that stands still must never look alive: silence counts as loss.
// The token comes in the fragment of the address, which is sent to nobody, and is taken out of the address bar at once.

const SILENT_MS = 1500; // a state comes every 200 ms
const RETRY_MS = 1000;
const CHECK_MS = 100;
const TOO_MANY = 1013; // the server's close code where as many pages are open as it serves
const PROTOCOL = "rfca-view";
const KEY = "token"; // for a page that is loaded again; no other tab and no other port of this machine sees it

function takeToken() {
  const given = new URLSearchParams(location.hash.slice(1)).get(KEY);
  if (location.hash) history.replaceState(null, "", location.pathname);
  // a browser that keeps nothing for pages still shows this one, until it is loaded again
  try {
    if (given) sessionStorage.setItem(KEY, given);
    return given || sessionStorage.getItem(KEY) || "";
  } catch {
    return given || "";
  }
}

export class Connection {
  // heard(message) for every message; changed(status, silent_ms) at every check, status one of "connecting", "open", "lost", "refused", "full"
  constructor(heard, changed) {
    this.token = takeToken();
    // another address of the same server, put into the address bar, would otherwise load nothing
    addEventListener("hashchange", () => location.reload());
    this.status = "connecting";
    this.heard = heard;
    this.changed = changed;
    this.lastHeardMs = performance.now();
    this.open();
    setInterval(() => this.check(), CHECK_MS);
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    // an address that was mangled must lead to a refusal, not to an exception: only these letters may name a protocol
    const token = /^[\w-]+$/.test(this.token) ? this.token : "none";
    const socket = new WebSocket(`${scheme}://${location.host}/stream`, [PROTOCOL, token]);
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
      const answer = await this.request("admitted");
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

  request(path, options = {}) {
    const headers = { ...options.headers, Authorization: `Bearer ${encodeURIComponent(this.token)}` };
    return fetch(`/${path}`, { ...options, headers, cache: "no-store" });
  }
}
