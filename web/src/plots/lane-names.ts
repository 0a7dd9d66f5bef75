/** The names of the lanes in the gutter, and one line under them that says what a lane means: by pointer, finger or keyboard. */
import type { Loss } from "../data/losses";
import type { Channel } from "../data/channels";
import type { TimeBase } from "../data/view-state";
import { count } from "../ui/format";
import { el, messageNodes } from "../ui/dom";
import type { Reads } from "./legend";
import { firstLanes, inPlace, type Lane, LANE_PX, lanesOf, roomFor, lossWords, stateAt, stateWords } from "./status-lanes";

export class LaneNames {
  lanes: readonly Lane[] = [];
  /** The line that explains; always there, so that nothing moves when it speaks. */
  readonly say = el("p", { class: "lanesay", "aria-live": "polite" });
  readonly #box: HTMLElement;
  readonly #list = el("div", { class: "lanenames" });
  /** Lanes of interest that do not stand there, and whether all were asked for. */
  #others = 0;
  /** Rows kept for lanes. */
  #room = 0;
  #all = false;
  #redo: () => void;
  /** Lane spoken of: 0 is the loss lane, undefined none. */
  #spoken: number | undefined;
  #text = "";

  /** `redo` is called when a person asks for more lanes, or for fewer. */
  constructor(box: HTMLElement, redo: () => void) {
    this.#box = box;
    this.#redo = redo;
    box.append(this.#list);
    box.addEventListener("pointermove", (event) => this.#speak(this.#laneAt(event)));
    box.addEventListener("pointerdown", (event) => this.#speak(this.#laneAt(event)));
    // A finger "leaves" as it is lifted: what it asked for stays, until it asks for something else.
    box.addEventListener("pointerleave", ({ pointerType }) => pointerType !== "touch" && this.#speak(undefined));
    this.#write();
  }

  /** Take on the lanes that are of interest now; true when their number changed. */
  choose(channels: readonly Channel[], absent: readonly string[] = []): boolean {
    const found = lanesOf(channels, absent);
    const first = firstLanes(found);
    const next = inPlace(this.lanes, this.#all ? found : first);
    const room = roomFor(channels, next);
    const others = found.length - first.length;
    const same = others === this.#others && room === this.#room && next.length === this.lanes.length;
    [this.#others, this.#room] = [others, room];
    if (same && next.every(({ key }, k) => key === this.lanes[k]?.key)) return false;
    this.lanes = next;
    this.#write();
    return true;
  }

  #write(): void {
    const rows = Math.max(this.lanes.length + (this.#others > 0 ? 1 : 0), this.#room) + 1;
    this.#box.style.height = `${rows * LANE_PX}px`;
    const names = ["Loss", ...this.lanes.map(({ name }) => name)];
    this.#list.replaceChildren(
      ...names.map((name, k) => {
        const button = el("button", { type: "button" }, name);
        button.addEventListener("focus", () => this.#speak(k));
        button.addEventListener("blur", () => this.#speak(undefined));
        return button;
      }),
      ...(this.#others > 0 ? [this.#moreButton()] : []),
    );
    this.#spoken = undefined;
  }

  /** The row under the lanes: those that say less, one click away. */
  #moreButton(): HTMLElement {
    const words = this.#all ? "Fewer lanes" : `${count(this.#others, "more lane")}`;
    const button = el("button", { type: "button", class: "all", "aria-expanded": String(this.#all) }, words);
    button.addEventListener("click", () => {
      this.#all = !this.#all;
      this.#redo();
      this.#list.querySelector<HTMLElement>("button.all")?.focus();
    });
    return button;
  }

  #laneAt(event: PointerEvent): number {
    const y = event.clientY - this.#box.getBoundingClientRect().top;
    return Math.min(this.lanes.length, Math.max(0, Math.floor(y / LANE_PX)));
  }

  #speak(lane: number | undefined): void {
    if (lane === this.#spoken) return;
    this.#spoken = lane;
    [...this.#list.children].forEach((child, k) => child.classList.toggle("on", k === lane));
  }

  /** Say what the lane spoken of means, and its state at `t`. */
  read(t: number, base: TimeBase, losses: readonly Loss[], reads: Reads): void {
    const [name, words] = this.#sentence(t, base, losses, reads);
    if (name + words === this.#text) return;
    this.#text = name + words;
    this.say.replaceChildren(...(name === "" ? [] : [el("b", {}, name), " ", ...messageNodes(words)]));
  }

  #sentence(t: number, base: TimeBase, losses: readonly Loss[], reads: Reads): readonly [string, string] {
    if (this.#spoken === undefined) return ["", ""];
    const lane = this.lanes[this.#spoken - 1];
    if (lane !== undefined) {
      const state = stateWords(lane.bits, stateAt({ ...lane, channel: reads(lane.channel, t) }, t, base));
      return [`${lane.name}${state === "" ? "" : `: ${state}`}`, docOf(lane, state)];
    }
    const here = losses.findLast(({ t0, t1 }) => t >= t0 && t <= t1) ?? (t === Infinity ? losses.at(-1) : undefined);
    if (here !== undefined) return [`Loss: ${lossWords(here)}`, here.text];
    return ["Loss", losses.length === 0 ? "Nothing is missing." : `${count(losses.length, "gap")} in memory.`];
  }
}

/** What a lane means; of a flag that is not set, what it would say. */
export function docOf({ bits: { doc, width } }: Pick<Lane, "bits">, state: string): string {
  if (doc === "" || width !== 1 || state !== "not set") return doc;
  return `When set: ${/^[A-Z][a-z]/.test(doc) ? doc.charAt(0).toLowerCase() + doc.slice(1) : doc}`;
}
