/**
 * What is in payloads that nobody has described? One entry for each kind: how many, how often, and the newest as bytes. What changed
 * since the entry was last written, at most twice a second, is marked. Only open entries are written.
 */
import { view } from "../data/view-state";
import { el, every, Live, type Panel } from "../ui/dom";
import { number } from "../ui/format";
import type { RawPayload } from "../wire/types";
import { type Deps, selected } from "./panel-context";
import { bytesOf, type HexLine, linesOf, type Run } from "./hex";

/** Entries that are open without being asked for. */
const OPEN = 2;

/** One kind of payload. */
class Entry {
  readonly root: HTMLDetailsElement;
  readonly #figures = new Live();
  readonly #bytes = el("pre", { class: "hex", tabindex: "0" });
  #shown: RawPayload | undefined;
  #before: Uint8Array | undefined;

  constructor(payload: RawPayload, open: boolean, describe: (() => void) | undefined) {
    const head = el("summary", {}, el("b", {}, payload.name), " ");
    if (!payload.verified) head.append(el("span", { class: "tag warn" }, "▲ unverified"), " ");
    head.append(el("span", { class: "dim num" }, this.#figures.node));
    head.title = payload.doc;
    this.#bytes.setAttribute("aria-label", `Newest payload ${payload.name}: offset, bytes, letters`);
    this.root = el("details", { class: "raw" }, head, this.#bytes);
    this.root.open = open;
    if (describe) {
      const button = el("button", { type: "button", class: "btn small edge" }, "Describe this type…");
      button.addEventListener("click", describe);
      this.root.append(button);
    }
  }

  write(payload: RawPayload): void {
    this.#figures.set(`${number(payload.rate, 1)} /s · ${number(payload.count, 0)} so far · ${number(payload.size, 0)} B`);
    if (!this.root.open || payload.hex === this.#shown?.hex) return;
    const bytes = bytesOf(payload.hex);
    const lines = linesOf(bytes, this.#before).map(lineOf);
    const rest = payload.size - bytes.length;
    this.#bytes.replaceChildren(...lines, ...(rest > 0 ? [`… and ${number(rest, 0)} B more`] : []));
    this.#before = bytes;
    this.#shown = payload;
  }
}

function lineOf({ offset, bytes, letters }: HexLine): HTMLElement {
  return el("div", {}, el("span", { class: "dim" }, `${offset}  `), ...bytes.map(runOf), " ", el("span", { class: "mid" }, ...letters.map(runOf)));
}

function runOf({ text, changed }: Run): Node {
  return changed ? el("mark", {}, text) : document.createTextNode(text);
}

/** Mounts into `host`. `describe` is offered where a person can say what a payload means. */
export function mountRaws(host: HTMLElement, deps: Deps, describe: (payload: RawPayload) => void): Panel {
  let known = "";
  let entries = new Map<string, Entry>();
  const due = every(2);
  return {
    update(now) {
      const device = selected(deps);
      const payloads = deps.store.raws.value.filter((payload) => payload.device === view.value.device);
      const names = `${device?.id} ${payloads.map(key).join(" ")}`;
      if (names === known && !due(now)) return;
      if (names !== known) {
        known = names;
        const told = device?.protocol === "idtp";
        entries = new Map(payloads.map((one, k) => [key(one), entries.get(key(one)) ?? new Entry(one, k < OPEN, told ? () => describe(one) : undefined)]));
        host.replaceChildren(...[...entries.values()].map(({ root }) => root));
      }
      for (const payload of payloads) entries.get(key(payload))?.write(payload);
    },
    dispose: () => host.replaceChildren(),
  };
}

function key({ device, name, verified }: RawPayload): string {
  return `${device}/${name}${verified ? "" : "?"}`;
}
