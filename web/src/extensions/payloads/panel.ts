/**
 * Content of undescribed payloads. One entry for each kind: how many, how often, and the newest as bytes. Changes since the entry was
 * last written, at most twice a second, are marked. Only open entries are written.
 */
import { el, throttle, LiveText, type Panel } from "../../ui/dom/dom";
import { number } from "../../ui/format/format";
import { protocolOf } from "../../wire/capabilities";
import type { UnknownPayload } from "../../wire/types";
import { selected } from "../../panels/panel-context";
import type { Deps } from "../../page/context";
import { COMMON } from "../../texts/common";
import { TEXT } from "./texts";
import "./payloads.css";

/** Entries that are initially open. */
const OPEN = 2;

/** One kind of payload. */
class Entry {
  readonly root: HTMLDetailsElement;
  readonly #figures = new LiveText();
  readonly #bytes = el("pre", { class: "payload-bytes", tabindex: "0" });
  #shown: UnknownPayload | undefined;
  #before: Uint8Array | undefined;
  #newest: UnknownPayload;

  constructor(
    payload: UnknownPayload,
    open: boolean,
    describe: (() => void) | undefined,
    frame: (payload: UnknownPayload) => void,
  ) {
    const head = el("summary", {}, el("b", {}, payload.name), " ");
    if (!payload.verified) head.append(el("span", { class: "tag warn" }, COMMON.unverified), " ");
    head.append(el("span", { class: "dim num" }, this.#figures.node));
    head.title = payload.doc;
    this.#bytes.setAttribute("aria-label", TEXT.newestPayload(payload.name));
    this.root = el("details", { class: "raw-payload text-xs" }, head, this.#bytes);
    this.root.open = open;
    const bytes = el(
      "button",
      { type: "button", class: "btn small edge", title: TEXT.payloadBytesHint },
      TEXT.payloadBytes,
    );
    bytes.addEventListener("click", () => frame(this.#newest));
    this.root.append(bytes);
    this.#newest = payload;
    if (describe) {
      const button = el("button", { type: "button", class: "btn small edge" }, TEXT.define);
      button.addEventListener("click", describe);
      this.root.append(button);
    }
  }

  write(payload: UnknownPayload): void {
    this.#newest = payload;
    this.#figures.set(TEXT.payloadFacts(number(payload.rate, 1), number(payload.count, 0), number(payload.size, 0)));
    if (!this.root.open || payload.hex === this.#shown?.hex) return;
    const bytes = hexBytes(payload.hex);
    const lines = hexLines(bytes, this.#before).map(lineOf);
    const rest = payload.size - bytes.length;
    this.#bytes.replaceChildren(...lines, ...(rest > 0 ? [TEXT.moreBytes(number(rest, 0))] : []));
    this.#before = bytes;
    this.#shown = payload;
  }
}

function lineOf({ offset, bytes, letters }: HexLine): HTMLElement {
  return el(
    "div",
    {},
    el("span", { class: "dim" }, `${offset}  `),
    ...bytes.map(runOf),
    " ",
    el("span", { class: "mid" }, ...letters.map(runOf)),
  );
}

function runOf({ text, changed }: Run): Node {
  return changed ? el("mark", {}, text) : document.createTextNode(text);
}

export function mountUnknownPayloads(host: HTMLElement, deps: Deps): Panel {
  let known = "";
  let entries = new Map<string, Entry>();
  const due = throttle(2);
  const frame = ({ device, arrival: time }: UnknownPayload): void =>
    deps.open.packet({ device, time, base: "arrival", pin: (at) => deps.viewState.actions.pinInView(at) });
  return {
    update(now) {
      const device = selected(deps);
      const payloads = deps.store.unknownPayloads.value.filter(
        (payload) => payload.device === deps.viewState.device.value,
      );
      const names = `${device?.id} ${payloads.map(key).join(" ")}`;
      if (names === known && !due(now)) return;
      if (names !== known) {
        known = names;
        const isDefinable = (protocolOf(device?.protocol)?.payload_option ?? "") !== "";
        entries = new Map(
          payloads.map((one, k) => [
            key(one),
            entries.get(key(one)) ??
              new Entry(one, k < OPEN, isDefinable ? () => deps.open.dialog("payloads/dialog", one) : undefined, frame),
          ]),
        );
        host.replaceChildren(...[...entries.values()].map(({ root }) => root));
      }
      for (const payload of payloads) entries.get(key(payload))?.write(payload);
    },
    dispose: () => host.replaceChildren(),
  };
}

function key({ device, name, verified }: UnknownPayload): string {
  return `${device}/${name}${verified ? "" : "?"}`;
}

/**
 * Hex dump of bytes, eight to a line: offset, hex, characters. Pure.
 */
const PER_LINE = 8;

/** A run of bytes of one line that changed together, or stayed. */
interface Run {
  readonly text: string;
  readonly changed: boolean;
}

interface HexLine {
  /** "0008" */
  readonly offset: string;
  /** The bytes, each followed by a space but the last; filled up to the width of a full line. */
  readonly bytes: readonly Run[];
  readonly letters: readonly Run[];
}

/** The bytes of a hex string, up to the first character that is not a hex digit. */
export function hexBytes(hex: string): Uint8Array {
  const digits = /^(?:[0-9a-f]{2})*/i.exec(hex)?.[0] ?? "";
  return Uint8Array.from({ length: digits.length / 2 }, (_, k) => parseInt(digits.slice(2 * k, 2 * k + 2), 16));
}

/** The lines of `bytes`; those that differ from `before` are marked. Without a `before` none are. */
export function hexLines(bytes: Uint8Array, before: Uint8Array | undefined): readonly HexLine[] {
  const changed = (k: number): boolean => before !== undefined && bytes[k] !== before[k];
  const lines: HexLine[] = [];
  for (let at = 0; at < bytes.length; at += PER_LINE) {
    const here = Array.from({ length: Math.min(PER_LINE, bytes.length - at) }, (_, k) => at + k);
    const pad = "   ".repeat(PER_LINE - here.length);
    const hex = runs(here, changed, (k) => `${(bytes[k] ?? 0).toString(16).toUpperCase().padStart(2, "0")} `);
    lines.push({
      offset: at.toString(16).toUpperCase().padStart(4, "0"),
      bytes: pad === "" ? hex : [...hex, { text: pad, changed: false }],
      letters: runs(here, changed, (k) => letter(bytes[k] ?? 0)),
    });
  }
  return lines;
}

function runs(
  places: readonly number[],
  changed: (k: number) => boolean,
  spell: (k: number) => string,
): readonly Run[] {
  const found: { text: string; changed: boolean }[] = [];
  for (const k of places) {
    const last = found.at(-1);
    if (last && last.changed === changed(k)) last.text += spell(k);
    else found.push({ text: spell(k), changed: changed(k) });
  }
  return found;
}

/** Printable ASCII unchanged, all else as a dot. */
function letter(byte: number): string {
  return byte >= 0x20 && byte < 0x7f ? String.fromCharCode(byte) : "·";
}
