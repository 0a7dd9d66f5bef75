/** The names of the lanes in the gutter, and one line under them that explains a lane: by pointer, finger or keyboard. */
import type { Loss } from "../data/losses";
import type { Channel } from "../data/channels";
import type { TimeBase, Reads } from "../data/view";
import { el, messageNodes } from "../ui/dom/dom";
import {
  firstLanes,
  inPlace,
  type Lane,
  LANE_PX,
  lanesOf,
  laneLossWords,
  stateAt,
  bitStateWords,
} from "./status-lanes";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/plots";

export class LaneNames {
  lanes: readonly Lane[] = [];
  /** The explaining line; over what is above the lanes, so that it needs no room and nothing moves. */
  readonly say = el("p", { class: "lane-description dim ellipsis", "aria-live": "polite" });
  readonly #box: HTMLElement;
  readonly #list = el("div", { class: "lane-names" });
  /** Number of hidden lanes of interest; all may be requested. */
  #others = 0;
  /** The most rows that these channels have needed: a lane that goes moves nothing. */
  #room = 0;
  #channels: readonly Channel[] = [];
  #all: boolean;
  #redo: () => void;
  /** Lane being explained: 0 is the loss lane, undefined none. */
  #spoken: number | undefined;
  #text = "";

  /** `redo` is called when the user requests more lanes, or fewer. @param all all lanes are shown at first */
  constructor(box: HTMLElement, redo: () => void, all = false) {
    this.#all = all;
    this.#box = box;
    this.#redo = redo;
    box.append(this.#list);
    box.addEventListener("pointermove", (event) => this.#speak(this.#laneAt(event)));
    box.addEventListener("pointerdown", (event) => this.#speak(this.#laneAt(event)));
    // a finger "leaves" when it is lifted: the lane stays explained until another one is touched
    box.addEventListener("pointerleave", ({ pointerType }) => pointerType !== "touch" && this.#speak(undefined));
    this.#write();
  }

  /** Set the lanes of interest; true if their number changed. */
  choose(channels: readonly Channel[], absent: readonly string[] = [], isLive = true): boolean {
    const found = lanesOf(channels, absent);
    const first = firstLanes(found, isLive);
    const next = inPlace(this.lanes, this.#all ? found : first);
    const others = found.length - first.length;
    const rows = next.length + (others > 0 ? 1 : 0);
    const room = channels === this.#channels ? Math.max(rows, this.#room) : rows;
    this.#channels = channels;
    const same = others === this.#others && room === this.#room && next.length === this.lanes.length;
    [this.#others, this.#room] = [others, room];
    if (same && next.every(({ key }, k) => key === this.lanes[k]?.key)) return false;
    this.lanes = next;
    this.#write();
    return true;
  }

  #write(): void {
    this.#box.style.height = `${(this.#room + 1) * LANE_PX}px`;
    const names = [COMMON.loss, ...this.lanes.map(({ name }) => name)];
    this.#list.replaceChildren(
      ...names.map((name, k) => {
        const button = el("button", { type: "button", class: "ellipsis" }, name);
        button.addEventListener("focus", () => this.#speak(k));
        button.addEventListener("blur", () => this.#speak(undefined));
        return button;
      }),
      ...(this.#others > 0 ? [this.#moreButton()] : []),
    );
    this.#spoken = undefined;
  }

  /** The row under the lanes: a button for the hidden ones. */
  #moreButton(): HTMLElement {
    const words = this.#all ? TEXT.fewerLanes : TEXT.moreLanes(this.#others);
    const button = el("button", { type: "button", class: "all ellipsis", "aria-expanded": String(this.#all) }, words);
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

  /** Explain the selected lane, and give its state at `t`. */
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
      const state = bitStateWords(lane.bits, stateAt({ ...lane, channel: reads(lane.channel, t) }, t, base));
      return [`${lane.name}${state === "" ? "" : `: ${state}`}`, docOf(lane, state)];
    }
    const here = losses.findLast(({ t0, t1 }) => t >= t0 && t <= t1) ?? (t === Infinity ? losses.at(-1) : undefined);
    if (here !== undefined) return [TEXT.lossHere(laneLossWords(here)), here.text];
    return [COMMON.loss, losses.length === 0 ? TEXT.noLoss : TEXT.gapsInMemory(losses.length)];
  }
}

/** Explanation of a lane; for a flag that is not set, the meaning of the set flag. */
export function docOf({ bits: { doc, width } }: Pick<Lane, "bits">, state: string): string {
  if (doc === "" || width !== 1 || state !== "not set") return doc;
  return TEXT.whenSet(/^[A-Z][a-z]/.test(doc) ? doc.charAt(0).toLowerCase() + doc.slice(1) : doc);
}
