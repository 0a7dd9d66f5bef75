/**
 * How does it lie? Horizon, turning body and the three numerals of the selected device, in the frame a person chose or the one
 * the device speaks. Live it shows the newest sample at the pace of the screen; paused it follows the cursor. A device
 * that sends no attitude gets words that say which output to switch on, and no empty instrument.
 */
import { effect } from "@preact/signals";
import { eulerOfMatrix, matrixIn, type WorldFrame } from "../data/rotations";
import { bodyOf, pairIn } from "../data/frames";
import type { Channel } from "../data/channels";
import { frame as chosenFrame } from "../data/view-state";
import { channelsOf, type Deps, reading, sampleAt, selected } from "../panels/panel-context";
import { trustOf } from "../panels/authenticity";
import { surface } from "../ui/canvas";
import { el, every, Live, type Panel, unit } from "../ui/dom";
import { number } from "../ui/format";
import { drawBody } from "./body";
import { mountGnss } from "./gnss";
import { drawHorizon } from "./horizon";
import { FRAMES, headingOf, horizonOf, pitchSign } from "./projection";
import { positionOf } from "./position";
import { type Source, sourceOf } from "./source";

/** Mounts into `host`, which becomes the attitude row; rebuilt when the device's channels change. `openTrack` shows the track large. */
export function mountAttitude(host: HTMLElement, deps: Deps, openTrack: () => void): Panel {
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
        const source = sourceOf(channels);
        const position = positionOf(channels);
        host.classList.toggle("with-gnss", position !== undefined);
        parts = [source ? mountInstruments(host, deps, source) : mountNone(host, deps)];
        if (position) parts = [...parts, mountGnss(host, deps, position, openTrack)];
      }
      for (const part of parts) part.update(now);
    },
    dispose: clear,
  };
}

/** What a device of each family has to send for a horizon. */
const ATTITUDES: Readonly<Record<string, string>> = {
  xbus: "Switch on Quaternion, RotationMatrix or EulerAngles among the outputs of the device, and the horizon appears here.",
  isb: "Have the device send INS 1, INS 2, INS 3 or INS 4, and the horizon appears here.",
  idtp: "Have the device send ImuQuat payloads, and the horizon appears here.",
};

function mountNone(host: HTMLElement, deps: Deps): Panel {
  const device = selected(deps);
  const raw = deps.store.raws.peek().some((payload) => payload.device === device?.id);
  const hint = raw ? "Its payloads have no description: see Raw payloads beside the plots." : (ATTITUDES[device?.protocol ?? ""] ?? "");
  const words = el("p", {}, hint);
  const box = el("div", { class: "none" }, el("h2", {}, "This device sends no orientation"), words);
  host.append(box);
  return { update: () => undefined, dispose: () => box.remove() };
}

function numeral(list: HTMLElement, name: string, axis: string, note: Node | string): Live {
  const live = new Live();
  const title = el("dt", {}, el("b", axis ? { class: axis } : {}, name), el("span", {}, note));
  const value = el("dd", { "data-numeral": name.toLowerCase() }, live.node, unit("°"));
  list.append(el("div", {}, title, value));
  return live;
}

/** Can it be known who sent this attitude? Empty where a protocol does not tell. */
function writeTrust(node: HTMLElement, deps: Deps, { verified }: Source): void {
  const device = selected(deps);
  const told = device && trustOf(device, deps.store.health.value.get(device.id));
  const text = !verified ? "▲ unverified" : told === undefined ? "" : told.word === "unverified" ? "● verified" : `${told.mark} ${told.word}`;
  if (node.textContent === text) return;
  node.textContent = text;
  node.className = verified ? "trustmark" : "trustmark tag warn";
  node.title = told?.detail ?? "";
}

const BODY_WORDS = { FLU: "forward, left, up", FRD: "forward, right, down" } as const;

/** The switch of frames, for everything on the page; pressing the one the device speaks returns to "as it is sent". */
function frameSwitch(native: WorldFrame): { readonly node: HTMLElement; dispose(): void } {
  const group = el("div", { class: "seg small", role: "group", "aria-label": "Frame of everything: attitude, body, plots and values" });
  const buttons = FRAMES.map((name) => {
    const button = el("button", { type: "button" }, name);
    const axes = `${name}, body axes ${BODY_WORDS[bodyOf(name)]}`;
    button.title = name === native ? `${axes}: as the device sends it` : `${axes}: attitude, plots and values converted from ${native}`;
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
  const horizonCanvas = el("canvas", { role: "img", "aria-label": "Artificial horizon" });
  const bodyCanvas = el("canvas", { role: "img", "aria-label": "Sensor body with its x, y and z axes" });
  const [frameName, pitchNote] = [new Live(), new Live()];
  const horizonCell = el("div", { class: "hor" }, horizonCanvas);
  const cap = el("div", { class: "cap" }, el("span", {}, "Body ", frameName.node), el("span", {}, "seen from SW"));
  const bodyCell = el("div", { class: "body3" }, cap, bodyCanvas);
  const list = el("dl");
  const heading = numeral(list, "Heading", "", "from north");
  const roll = numeral(list, "Roll", "x", "about x");
  const pitch = numeral(list, "Pitch", "y", pitchNote.node);
  const choice = frameSwitch(deps.store.nativeFrame(source.channel.info.device) ?? source.frame);
  const trust = el("span", { class: "trustmark" });
  const top = el("div", { class: "frame" }, choice.node, trust, el("span", { class: "from", title: source.detail }, source.words));
  const numsCell = el("div", { class: "nums" }, top, list);
  host.append(horizonCell, bodyCell, numsCell);

  let drawn = "";
  const redraw = (): void => {
    drawn = "";
  };
  const [horizonOn, bodyOn] = [surface(horizonCanvas, redraw), surface(bodyCanvas, redraw)];
  const textDue = every(12);
  return {
    update(now) {
      const i = sampleAt(source.channel, reading(deps));
      const frame = chosenFrame.value ?? source.frame;
      const { ring } = source.channel;
      const key = `${ring.revision} ${i} ${frame} ${document.documentElement.dataset["theme"]}`;
      const read = i < 0 ? undefined : source.at(i);
      const told = read && pairIn(read, source.frame, frame);
      const enu = told && matrixIn(told, frame, "ENU");
      if (key !== drawn) {
        drawn = key;
        drawHorizon(horizonOn, enu && horizonOf(enu, frame));
        drawBody(bodyOn, enu, frame);
      }
      if (!textDue(now)) return;
      const angles = told && eulerOfMatrix(told);
      heading.set(number(enu && headingOf(enu), 1));
      roll.set(number(angles?.[0], 1));
      pitch.set(number(angles?.[1], 1));
      frameName.set(`${bodyOf(frame)} in ${frame}`);
      writeTrust(trust, deps, source);
      pitchNote.set(`about y, ${pitchSign(frame)}`);
    },
    dispose() {
      horizonOn.dispose();
      bodyOn.dispose();
      choice.dispose();
      for (const cell of [horizonCell, bodyCell, numsCell]) cell.remove();
    },
  };
}
