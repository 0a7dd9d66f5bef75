/** Where is it? Fix, satellites, position, accuracy and age, and the track of the window; only where the device sends a position. */
import { type Deps, reading, sampleAt } from "../panels/panel-context";
import { surface } from "../ui/canvas";
import { el, every, Live, type Panel, unit } from "../ui/dom";
import { age, geographic, NONE, number } from "../ui/format";
import { pathOf } from "./path";
import { fixLine, isPlace, metresOf, type Position } from "./position";
import { drawTrack } from "./track";

/** Points drawn at most: a cell of 200 px shows no more. */
const POINTS = 400;

type Texts = Readonly<Record<"fix" | "lat" | "lon" | "h" | "v" | "age" | "ageUnit", Live>>;

/** Mounts the cell into `host`; `open` shows the track larger. */
export function mountGnss(host: HTMLElement, deps: Deps, position: Position, open: () => void): Panel {
  const texts: Texts = { fix: new Live(), lat: new Live(), lon: new Live(), h: new Live(), v: new Live(), age: new Live(), ageUnit: new Live() };
  const canvas = el("canvas", { "aria-hidden": "true" });
  const button = el("button", { type: "button", class: "enlarge", title: "Show the track larger", "aria-label": "Track within the window, north up: show it larger" }, canvas);
  button.addEventListener("click", open);
  const list = el("dl", {}, el("dt", {}, "Lat"), el("dd", {}, texts.lat.node, unit("°")));
  list.append(el("dt", {}, "Lon"), el("dd", {}, texts.lon.node, unit("°")));
  if (position.horizontal && position.vertical) {
    list.append(el("dt", {}, "±"), el("dd", {}, texts.h.node, unit("m hor."), "\u2002", texts.v.node, unit("m vert.")));
  }
  list.append(el("dt", {}, "Age"), el("dd", {}, texts.age.node, el("span", { class: "u" }, texts.ageUnit.node)));
  const cap = el("div", { class: "cap" }, el("span", {}, "GNSS"), el("span", { class: "ell" }, texts.fix.node));
  const cell = el("div", { class: "gnss", title: position.channel.info.group }, cap, button, list);
  host.append(cell);
  const to = surface(canvas, () => undefined);
  const due = every(5);
  return {
    update(frame) {
      if (!due(frame)) return;
      const at = reading(deps);
      const i = sampleAt(position.channel, at);
      writeTexts(deps, position, i, texts);
      const { points, here } = pathOf(position, at, i, POINTS);
      drawTrack(to, points, here);
    },
    dispose() {
      to.dispose();
      cell.remove();
    },
  };
}

function writeTexts(deps: Deps, position: Position, i: number, texts: Texts): void {
  const { ring } = position.channel;
  const [lat, lon] = i < 0 ? [NaN, NaN] : [ring.value(position.lat, i), ring.value(position.lon, i)];
  const known = isPlace(lat, lon);
  texts.lat.set(geographic(known ? lat : undefined));
  texts.lon.set(geographic(known ? lon : undefined));
  texts.h.set(number(metresOf(position, position.horizontal, i), 2));
  texts.v.set(number(metresOf(position, position.vertical, i), 2));
  texts.fix.set(fixLine(position, i) || NONE);
  const old = age(i < 0 ? undefined : deps.store.serverNow() - ring.arrival(i));
  texts.age.set(old.value);
  texts.ageUnit.set(old.unit);
}
