/** GNSS cell: fix, satellites, position, accuracy, age and the track of the window; shown if the device sends a position. */
import { channelsOf, reading, sampleAt } from "../../panels/panel-context";
import type { Deps } from "../../page/context";
import { surface } from "../../ui/dom/canvas";
import { el, throttle, LiveText, type Panel, unit } from "../../ui/dom/dom";
import { age, geographic, NONE, number } from "../../ui/format/format";
import { pathOf } from "./path";
import { fixLine, isPlace, metresOf, type Position, positionOf } from "./position";
import { drawTrack } from "./track";

import "./map.css";
import { TEXT } from "./texts";

/** Points drawn at most: a cell of 200 px resolves no more. */
const MAX_POINTS = 400;

type Texts = Readonly<Record<"fix" | "lat" | "lon" | "h" | "v" | "age" | "ageUnit", LiveText>>;

/** Mounts the cell into `host`; its button enlarges the track. */
export function mountGnss(host: HTMLElement, deps: Deps): Panel {
  const position = positionOf(channelsOf(deps));
  if (!position) return { update: () => undefined, dispose: () => undefined };
  const texts: Texts = {
    fix: new LiveText(),
    lat: new LiveText(),
    lon: new LiveText(),
    h: new LiveText(),
    v: new LiveText(),
    age: new LiveText(),
    ageUnit: new LiveText(),
  };
  const canvas = el("canvas", { "aria-hidden": "true" });
  const button = el(
    "button",
    {
      type: "button",
      class: "enlarge",
      title: TEXT.enlargeTrack,
      "aria-label": TEXT.trackLabel,
    },
    canvas,
  );
  button.addEventListener("click", () => deps.open.dialog("map/dialog", {}));
  const list = el("dl", {}, el("dt", {}, TEXT.lat), el("dd", {}, texts.lat.node, unit("°")));
  list.append(el("dt", {}, TEXT.lon), el("dd", {}, texts.lon.node, unit("°")));
  if (position.horizontal && position.vertical) {
    list.append(
      el("dt", {}, "±"),
      el("dd", {}, texts.h.node, unit(TEXT.mHor), "\u2002", texts.v.node, unit(TEXT.mVert)),
    );
  }
  list.append(el("dt", {}, TEXT.age), el("dd", {}, texts.age.node, el("span", { class: "unit" }, texts.ageUnit.node)));
  const cap = el(
    "div",
    { class: "caption" },
    el("span", {}, TEXT.gnss),
    el("span", { class: "ellipsis" }, texts.fix.node),
  );
  host.classList.add("gnss");
  host.title = position.channel.info.group;
  host.append(cap, button, list);
  const to = surface(canvas, () => undefined);
  const due = throttle(5);
  return {
    update(frame) {
      if (!due(frame)) return;
      const at = reading(deps);
      const i = sampleAt(position.channel, at);
      writeTexts(deps, position, i, texts);
      const { points, here } = pathOf(position, at, i, MAX_POINTS);
      drawTrack(to, points, here);
    },
    dispose() {
      to.dispose();
      host.replaceChildren();
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
