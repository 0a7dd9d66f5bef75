/**
 * Attitude of the selected device: horizon, turning body and three numerals, in the frame chosen by the user or sent by the
 * device. Live it shows the newest sample at the screen's rate; paused it follows the cursor. For a device without attitude it names
 * the output to switch on instead of an empty instrument.
 */
import { effect } from "@preact/signals";
import { fromExtensions } from "../extension/extension";
import { eulerOfMatrix, matrixIn, type WorldFrame } from "../data/rotations";
import { bodyOf, pairIn } from "../data/frames";
import type { Channel } from "../data/channels";
import type { ViewState } from "../data/view-state";
import { channelsOf, momentWords, reading, sampleAt, selected } from "../panels/panel-context";
import type { Deps } from "../page/context";
import { trustOf } from "../panels/authenticity";
import { surface } from "../ui/dom/canvas";
import { el, throttle, LiveText, type Panel, unit } from "../ui/dom/dom";
import { number } from "../ui/format/format";
import { protocolOf, embeddedKinds } from "../wire/capabilities";
import { drawBody } from "./body";
import { drawHorizon } from "./horizon";
import { FRAMES, headingOf, horizonOf, pitchSign } from "./projection";
import { type Source, attitudeSource } from "./source";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/attitude";
import { registerPanel } from "../panels/registry";

export interface AttitudeCell {
  /** Whether it has something to show of a device with these channels. */
  readonly applies: (channels: readonly Channel[]) => boolean;
  readonly mount: (host: HTMLElement, deps: Deps) => Panel;
}

declare module "../extension/extension" {
  interface Extension {
    /** Cells beside the attitude. */
    readonly attitudeCells?: readonly AttitudeCell[];
  }
}

/** Mounts into `host`, the attitude row; rebuilt when the device's channels change. */
export function mountAttitude(host: HTMLElement, deps: Deps): Panel {
  let shown: readonly Channel[] | undefined;
  let parts: readonly Panel[] = [];
  const clear = (): void => {
    for (const part of parts) part.dispose();
    parts = [];
  };
  return {
    update(now) {
      const channels = channelsOf(deps);
      if (!shown || channels.length !== shown.length || channels.some((channel, i) => channel !== shown?.[i])) {
        shown = channels;
        clear();
        const source = attitudeSource(channels);
        const cells = fromExtensions("attitudeCells").filter(({ applies }) => applies(channels));
        host.classList.toggle("with-cell", cells.length > 0);
        parts = [source ? mountInstruments(host, deps, source) : mountNone(host, deps, channels)];
        parts = [...parts, ...cells.map((cell) => mountCell(host, deps, cell))];
      }
      for (const part of parts) part.update(now);
    },
    dispose: clear,
  };
}

function mountCell(host: HTMLElement, deps: Deps, { mount }: AttitudeCell): Panel {
  const box = el("div", { class: "attitude-cell" });
  host.append(box);
  const panel = mount(box, deps);
  return {
    update: (now) => panel.update(now),
    dispose() {
      panel.dispose();
      box.remove();
    },
  };
}

function mountNone(host: HTMLElement, deps: Deps, channels: readonly Channel[]): Panel {
  const device = selected(deps);
  const raw = deps.store.unknownPayloads.peek().some((payload) => payload.device === device?.id);
  const ofFamily = protocolOf(device?.protocol)?.attitude_hint ?? "";
  const hint = raw ? TEXT.payloadsUndefined : attitudeHint(channels, ofFamily);
  const words = el("p", {}, hint);
  const box = el("div", { class: "no-orientation mid" }, el("h2", {}, TEXT.noOrientation), words);
  host.append(box);
  return { update: () => undefined, dispose: () => box.remove() };
}

function numeral(list: HTMLElement, name: string, axis: string, note: Node | string): LiveText {
  const live = new LiveText();
  const title = el("dt", {}, el("b", axis ? { class: `axis-${axis}` } : {}, name), el("span", {}, note));
  const value = el("dd", { "data-numeral": name.toLowerCase() }, live.node, unit("°"));
  list.append(el("div", {}, title, value));
  return live;
}

/** Verification of the attitude's sender; empty if the protocol does not provide it. */
function writeTrust(node: HTMLElement, deps: Deps, { verified }: Source): void {
  const device = selected(deps);
  const trust = device && trustOf(device, deps.store.health.value.get(device.id));
  const text = !verified
    ? COMMON.unverified
    : trust === undefined
      ? ""
      : trust.state === "unverified"
        ? TEXT.verified
        : `${trust.mark} ${trust.word}`;
  if (node.textContent === text) return;
  node.textContent = text;
  node.className = verified ? "trust-mark" : "trust-mark tag warn";
  node.title = trust?.detail ?? "";
}

const BODY_WORDS = { FLU: TEXT.forwardLeftUp, FRD: TEXT.forwardRightDown } as const;

/** The frame switch, for the whole page; pressing the device's own frame returns to "as it is sent". */
function frameSwitch(
  native: WorldFrame,
  chosenFrame: ViewState["frame"],
): { readonly node: HTMLElement; dispose(): void } {
  const group = el("div", {
    class: "segmented small",
    role: "group",
    "aria-label": TEXT.frameHint,
  });
  const buttons = FRAMES.map((name) => {
    const button = el("button", { type: "button" }, name);
    const axes = TEXT.bodyAxes(name, BODY_WORDS[bodyOf(name)]);
    button.title = name === native ? TEXT.nativeFrame(axes) : TEXT.convertedFrame(axes, native);
    button.addEventListener("click", () => {
      chosenFrame.value = name === native ? undefined : name;
    });
    group.append(button);
    return button;
  });
  const dispose = effect(() => {
    const shown = chosenFrame.value ?? native;
    FRAMES.forEach((name, i) => buttons[i]?.setAttribute("aria-pressed", String(name === shown)));
  });
  return { node: group, dispose };
}

function mountInstruments(host: HTMLElement, deps: Deps, source: Source): Panel {
  const horizonCanvas = el("canvas", { role: "img", "aria-label": TEXT.artificialHorizon });
  const bodyCanvas = el("canvas", { role: "img", "aria-label": TEXT.bodyLabel });
  const [frameName, pitchNote] = [new LiveText(), new LiveText()];
  const horizonCell = el("div", { class: "horizon" }, horizonCanvas);
  const cap = el(
    "div",
    { class: "caption" },
    el("span", {}, TEXT.body, frameName.node),
    el("span", {}, TEXT.seenFromSw),
  );
  const bodyCell = el("div", { class: "body-view" }, cap, bodyCanvas);
  const list = el("dl");
  const heading = numeral(list, TEXT.heading, "", TEXT.fromNorth);
  const roll = numeral(list, TEXT.roll, "x", TEXT.aboutX);
  const pitch = numeral(list, TEXT.pitch, "y", pitchNote.node);
  const { frame: chosenFrame } = deps.viewState;
  const choice = frameSwitch(deps.store.nativeFrame(source.channel.info.device) ?? source.frame, chosenFrame);
  const trust = el("span", { class: "trust-mark" });
  const from = new LiveText();
  const origin = el("span", { class: "from ellipsis", title: source.detail }, from.node);
  const top = el("div", { class: "frame" }, choice.node, trust, origin);
  const numsCell = el("div", { class: "numerals" }, top, list);
  host.append(horizonCell, bodyCell, numsCell);

  let drawn = "";
  const redraw = (): void => {
    drawn = "";
  };
  const [horizonOn, bodyOn] = [surface(horizonCanvas, redraw), surface(bodyCanvas, redraw)];
  const textDue = throttle(12);
  return {
    update(now) {
      const at = reading(deps);
      const i = sampleAt(source.channel, at);
      const frame = chosenFrame.value ?? source.frame;
      const { ring } = source.channel;
      const key = `${ring.revision} ${i} ${frame} ${document.documentElement.dataset["theme"]}`;
      const read = i < 0 ? undefined : source.at(i);
      const rotation = read && pairIn(read, source.frame, frame);
      const enu = rotation && matrixIn(rotation, frame, "ENU");
      if (key !== drawn) {
        drawn = key;
        drawHorizon(horizonOn, enu && horizonOf(enu, frame));
        drawBody(bodyOn, enu, frame);
      }
      if (!textDue(now)) return;
      const angles = rotation && eulerOfMatrix(rotation);
      heading.set(number(enu && headingOf(enu), 1));
      roll.set(number(angles?.[0], 1));
      pitch.set(number(angles?.[1], 1));
      frameName.set(TEXT.bodyInFrame(bodyOf(frame), frame));
      writeTrust(trust, deps, source);
      from.set(at.word === "now" ? TEXT.nowFrom(source.words) : momentWords(at));
      host.classList.toggle("off-screen", at.isOffScreen);
      pitchNote.set(TEXT.aboutY(pitchSign(frame)));
    },
    dispose() {
      horizonOn.dispose();
      bodyOn.dispose();
      choice.dispose();
      for (const cell of [horizonCell, bodyCell, numsCell]) cell.remove();
    },
  };
}

/** What gives an attitude: the hint of the family, but for a receiver alone (UBX, NMEA), which is not of the family that reads it. */
export function attitudeHint(channels: readonly Channel[], ofFamily: string): string {
  const kinds = embeddedKinds(channels.map(({ info }) => info));
  if (kinds.size === 0) return ofFamily;
  return kinds.has("UBX") ? TEXT.ubxAttitude : TEXT.nmeaAttitude;
}

registerPanel({
  id: "attitude",
  title: COMMON.attitude,
  where: "main",
  order: 0,
  class: "attitude",
  isWide: true,
  mount: mountAttitude,
});
