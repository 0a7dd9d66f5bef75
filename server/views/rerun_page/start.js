/**
 * Starts Rerun's viewer on what the address names, and on nothing else:
 *
 *   /rerun/?recording=ID[&t0=…&t1=…]    a recording, or a stretch of it, from our own API
 *   /rerun/?live[=DEVICE]               what devices send now
 *
 * A long recording is thinned, because a browser does not hold an hour of samples: `all` asks for every one.
 * `theme=light|dark` chooses its look. The viewer's own files are scripts of wasm-bindgen (`wasm_bindgen`, WebHandle).
 */
"use strict";

const words = document.getElementById("words");
const lagLine = document.getElementById("lag");
const query = new URLSearchParams(location.search);
/** A module of one function that uses a 128-bit instruction: the viewer is made of such. */
const SIMD = new Uint8Array([0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 10, 1, 8, 0, 65, 0, 253, 15, 253, 98, 11]);
/** Rows of a quantity that a viewer without a GPU still draws while one waits. */
const MOST = 20000;
const AGAIN_MS = 1000;
const LATE_MS = 500;
const HIDDEN_MS = 250;

/** The viewer would ask its makers for news and tell them of its use: nothing leaves for another host; it hears of no news. */
const ask = window.fetch.bind(window);
window.fetch = (what, how) => {
  const url = new URL(what instanceof Request ? what.url : what, location.href);
  if (url.origin === location.origin || url.protocol === "data:" || url.protocol === "blob:") return ask(what, how);
  return Promise.resolve(new Response(null, { status: 204 }));
};

/** What the address asks for; undefined when it asks for nothing. */
function wanted() {
  const recording = query.get("recording");
  if (recording) {
    const range = new URLSearchParams();
    for (const name of ["t0", "t1"]) if (query.get(name)) range.set(name, String(Number(query.get(name))));
    if (!query.has("all")) range.set("most", String(MOST));
    const url = new URL(`../api/recordings/${encodeURIComponent(recording)}/recording.rrd?${range}`, location.href);
    return { url: url.href };
  }
  return query.has("live") ? { live: query.get("live") } : undefined;
}

function say(text) {
  words.textContent = text;
}

/** Asks the server whether the recording is open, and waits while it is being decoded. */
async function opened(url) {
  const about = url.replace(/\/recording\.rrd\?.*$/, "");
  for (;;) {
    const answer = await fetch(about);
    if (answer.status === 202) {
      const state = await answer.json();
      say(`Opening the recording… ${Math.round(100 * state.progress)} %`);
      await new Promise((done) => setTimeout(done, AGAIN_MS / 4));
      continue;
    }
    if (answer.ok) return;
    const problem = await answer.json().catch(() => ({ message: `The server answered ${answer.status}.`, hint: "" }));
    throw new Error(`${problem.message} ${problem.hint}`.trim());
  }
}

async function main() {
  if (!WebAssembly.validate(SIMD)) throw new Error("This browser is too old for the viewer: it needs WebAssembly SIMD.");
  const what = wanted();
  if (!what) throw new Error("This address names no recording. Open one from the page.");
  const ready = what.url ? opened(what.url) : Promise.resolve();
  await wasm_bindgen({ module_or_path: new URL("re_viewer_bg.wasm", location.href) });
  await ready;
  say("");
  const handle = new wasm_bindgen.WebHandle({
    url: what.url ? [what.url] : [],
    hide_welcome_screen: true,
    persist: false,
    enable_history: false,
    theme: query.get("theme") ?? "system",
    render_backend: query.get("renderer") ?? undefined,
  });
  await handle.start(document.getElementById("canvas"));
  watch(handle);
  if (what.live !== undefined) follow(handle, what.live);
  if (window !== window.parent) window.parent.postMessage({ kind: "rerun-ready" }, location.origin);
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

/** How late the picture is, and what was left out for it. */
function tell(state) {
  lagLine.hidden = false;
  if (state.kind === "lost") {
    lagLine.textContent = `${state.message || "The stream broke off."} Trying again.`;
    lagLine.classList.add("late");
    return;
  }
  const dropped = state.dropped ? ` · ${state.dropped} left out` : "";
  lagLine.textContent = `${Math.round(state.lag_ms)} ms behind${dropped}`;
  lagLine.classList.toggle("late", state.lag_ms > LATE_MS || state.dropped > 0);
}

main().catch((error) => say(String(error.message ?? error)));
