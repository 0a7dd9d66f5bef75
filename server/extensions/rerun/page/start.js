/**
 * Starts Rerun's viewer on what the address names, and on nothing else:
 *
 *   /rerun/?recording=ID[&t0=…&t1=…]    a recording, or a stretch of it, from our own API
 *   /rerun/?live[=DEVICE]               what devices send now
 *
 * A long recording is thinned, because a browser does not hold an hour of samples, and the line below the viewer says how far;
 * `all` asks for as much as a browser holds. `theme=light|dark` chooses its look. The viewer's own files are scripts of wasm-bindgen (`wasm_bindgen`, WebHandle).
 */
"use strict";

const words = document.getElementById("words");
const foot = document.getElementById("foot");
const amountLine = document.getElementById("amount");
const lagLine = document.getElementById("lag");
const query = new URLSearchParams(location.search);
const theme = query.get("theme") ?? (matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark");
document.documentElement.dataset.theme = theme;
/** A module of one function that uses a 128-bit instruction: the viewer is made of such. */
const SIMD = new Uint8Array([0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 10, 1, 8, 0, 65, 0, 253, 15, 253, 98, 11]);
/** The viewer tells its console of every frame it draws, thousands of lines a minute: warnings and errors are then not to be found. */
console.debug = () => undefined;
const AGAIN_MS = 1000;
const LATE_MS = 500;
const HIDDEN_MS = 250;

/**
 * The viewer would ask its makers for news and tell them of its use, and a tile server for the pictures under a map: nothing leaves for
 * another host. It hears of no news; its map gets the pictures of the tile server that ours is configured with, or none.
 */
const ask = window.fetch.bind(window);
const TILE = /^\/(\d+)\/(\d+)\/(\d+)\.png$/;
window.fetch = async (what, how) => {
  const url = new URL(what instanceof Request ? what.url : what, location.href);
  if (url.origin === location.origin || url.protocol === "data:" || url.protocol === "blob:") return await ask(what, how);
  const tile = url.hostname === "tile.openstreetmap.org" ? TILE.exec(url.pathname) : null;
  if (tile && (await hasTiles())) return await ask(new URL(`../api/tiles/${tile[1]}/${tile[2]}/${tile[3]}`, location.href));
  return new Response(null, { status: 204 });
};

/** Is a tile server configured? Then whom its pictures are owed to is said. */
function hasTiles() {
  known ??= (async () => {
    const { tiles, attribution } = await (await ask(new URL("../api/map", location.href))).json();
    if (tiles && attribution) {
      document.getElementById("owed").textContent = `Map: ${attribution}`;
      foot.hidden = false;
    }
    return tiles;
  })().catch(() => false);
  return known;
}
let known;

/** What the address asks for; undefined when it asks for nothing. */
function wanted() {
  const recording = query.get("recording");
  if (recording) {
    const range = new URLSearchParams();
    for (const name of ["t0", "t1"]) if (query.get(name)) range.set(name, String(Number(query.get(name))));
    return { recording: new URL(`../api/recordings/${encodeURIComponent(recording)}`, location.href).href, range };
  }
  return query.has("live") ? { live: query.get("live") } : undefined;
}

function say(text) {
  words.textContent = text;
}

/** The words of an answer that is none. */
async function problemOf(answer) {
  const problem = await answer.json().catch(() => ({ message: `The server answered ${answer.status}.`, hint: "" }));
  return new Error(`${problem.message} ${problem.hint}`.trim());
}

/** Asks the server whether the recording is open, and waits while it is being decoded; then for where its samples are. */
async function opened({ recording, range }) {
  for (;;) {
    const answer = await fetch(recording);
    if (answer.status !== 202) {
      if (!answer.ok) throw await problemOf(answer);
      const { info } = await answer.json();
      return await samples(recording, range, info.title || info.id);
    }
    const state = await answer.json();
    say(`Opening the recording… ${Math.round(100 * state.progress)} %`);
    await new Promise((done) => setTimeout(done, AGAIN_MS / 4));
  }
}

/** The address of as many samples as the viewer gets; says how many that are when it is not all of them. */
async function samples(recording, range, title) {
  const asked = async (all) => {
    const answer = await fetch(`${recording}/amount?${new URLSearchParams([...range, ["all", all]])}`);
    if (!answer.ok) throw await problemOf(answer);
    return await answer.json();
  };
  const amount = await asked(query.has("all"));
  const url = `${recording}/recording.rrd?${new URLSearchParams([...range, ["most", amount.most]])}`;
  if (amount.every > 1) {
    const more = query.has("all") ? amount : await asked(true);
    tellAmount(amount, more, `${recording}/recording.rrd?${range}`, title);
  }
  return url;
}

/** What is left out, why, and how to see it. */
function tellAmount(amount, more, file, title) {
  const part = (tag, text, set = {}) => Object.assign(document.createElement(tag), { textContent: text }, set);
  const kept = `${ordinal(amount.every)} sample is shown`;
  amountLine.append(part("b", `Every ${kept}`), `, and of curves the least and the greatest between: all ${millions(amount.rows)} are more than a browser holds. `);
  if (amount.whole_s >= 1) amountLine.append(`A loop range of up to ${length(amount.whole_s)} opens whole. `);
  if (more.shown > 1.5 * amount.shown) {
    const href = new URL(location.href);
    href.searchParams.set("all", "");
    const words = more.every > 1 ? `Show every ${ordinal(more.every)}` : "Show every sample";
    amountLine.append(part("a", words, { href: href.href, title: `${millions(more.shown)}: that takes a while` }), " ");
  }
  amountLine.append(part("a", "Download all", { href: file, download: `${title}.rrd`, title: "An .rrd file with every sample, for a Rerun viewer outside the browser" }));
  foot.hidden = false;
}

function ordinal(n) {
  const ending = { 1: "st", 2: "nd", 3: "rd" }[n % 10];
  return `${n.toLocaleString("en").replaceAll(",", "\u2009")}${ending && Math.floor((n % 100) / 10) !== 1 ? ending : "th"}`;
}

function millions(rows) {
  return `${(rows / 1e6).toFixed(1)} million values`;
}

function length(seconds) {
  return seconds < 120 ? `${Math.floor(seconds)} s` : `${Math.floor(seconds / 60)} min`;
}

async function main() {
  if (!WebAssembly.validate(SIMD)) throw new Error("This browser is too old for the viewer: it needs WebAssembly SIMD.");
  const what = wanted();
  if (!what) throw new Error("This address names no recording. Open one from the page.");
  const address = what.recording ? opened(what) : Promise.resolve();
  const viewer = wasm_bindgen({ module_or_path: new URL("re_viewer_bg.wasm", location.href) });
  const [url] = await Promise.all([address, viewer]); // what cannot be opened is said before the viewer is here
  say("");
  const handle = new wasm_bindgen.WebHandle({
    url: url ? [url] : [],
    hide_welcome_screen: true,
    persist: false,
    enable_history: false,
    theme,
    render_backend: query.get("renderer") ?? undefined,
  });
  await handle.start(document.getElementById("canvas"));
  if (url) sayLoading(url);
  watch(handle);
  if (what.live !== undefined) follow(handle, what.live);
  if (window !== window.parent) window.parent.postMessage({ kind: "rerun-ready" }, location.origin);
}

/** The viewer shows empty plots while samples are on their way: that is said until the last one is here. */
function sayLoading(url) {
  const { pathname } = new URL(url, location.href);
  say("Loading the samples…");
  const seen = new PerformanceObserver((list) => {
    if (!list.getEntries().some(({ name }) => new URL(name).pathname === pathname)) return;
    seen.disconnect();
    if (words.textContent === "Loading the samples…") say("");
  });
  seen.observe({ type: "resource", buffered: true });
}

/** A viewer that fell over says so. */
function watch(handle) {
  if (!handle.has_panicked()) {
    setTimeout(watch, AGAIN_MS, handle);
    return;
  }
  document.getElementById("canvas").remove();
  say(`The viewer stopped: ${handle.panic_message() ?? "no reason given"}. Reload to start it again.`);
}

/** Feeds the viewer from the live stream, and again when that broke off. */
function follow(handle, device) {
  let channel = 0;
  const address = new URL("live", location.href);
  address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
  if (device) address.searchParams.set("device", device);
  const connect = () => {
    const id = `live ${++channel}`;
    const socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => handle.open_channel(id, id);
    let taken = 0;
    const took = () => {
      if (socket.readyState === WebSocket.OPEN) socket.send(String(taken));
    };
    socket.onmessage = ({ data }) => {
      if (typeof data === "string") {
        tell(JSON.parse(data));
        return;
      }
      handle.send_rrd_to_channel(id, new Uint8Array(data));
      taken++;
      // Said after the viewer has had a frame; in a hidden tab, which has none, after a while.
      const timer = setTimeout(took, HIDDEN_MS);
      requestAnimationFrame(() => (clearTimeout(timer), took()));
    };
    socket.onclose = ({ reason }) => {
      handle.close_channel(id);
      tell({ kind: "lost", message: reason });
      setTimeout(connect, 2 * AGAIN_MS);
    };
  };
  connect();
}

/** Shortest time from the server to this page, ms, with the difference of both clocks: what a report takes longer, it waited. */
let shortest = Infinity;

/** Age of the newest sample in the picture, ms: that when it was sent, and what it has waited for in this browser since. */
function lateness({ lag_ms: lag, sent_ms: sent }, now) {
  shortest = Math.min(shortest, now - sent);
  return lag + now - sent - shortest;
}

/** How late the picture is, and what was left out for it. */
function tell(state) {
  foot.hidden = false;
  if (state.kind === "lost") {
    lagLine.textContent = `${state.message || "The stream broke off."} Trying again.`;
    lagLine.classList.add("late");
    return;
  }
  const dropped = state.dropped ? ` · ${state.dropped} left out` : "";
  const late = lateness(state, Date.now());
  lagLine.textContent = `${late < 10_000 ? `${Math.round(late)} ms` : `${(late / 1000).toFixed(1)} s`} behind${dropped}`;
  lagLine.classList.toggle("late", late > LATE_MS || state.dropped > 0);
}

main().catch((error) => say(String(error.message ?? error)));
