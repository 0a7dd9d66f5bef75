/**
 * The enlarged track: on a metric grid with scale bar and north; drag to move, wheel or buttons to zoom, the arrow keys and
 * + − 0 by keyboard. It follows the window until the user moves it; `Fit` makes it follow again. With a configured tile server a
 * map lies under it, which can be switched off.
 */
import { channelsOf, reading, sampleAt } from "../../panels/panel-context";
import type { Deps } from "../../page/context";
import { type Surface, surface } from "../../ui/dom/canvas";
import { el, throttle, LiveText, type Panel } from "../../ui/dom/dom";
import { geographic, NONE } from "../../ui/format/format";
import { api } from "../../requests/http";
import { pathOf } from "./path";
import { fixLine, isPlace, positionOf } from "./position";
import { drawTrack, type Ground, STYLES, stretches, type TrackView, zoomedTrack } from "./track";
import { type Origin, TileCache, tilesUnder } from "./tiles";

import "./map.css";
import { TEXT } from "./texts";

const MAX_POINTS = 4000;
/** Opacity of the map: the track must stand out. */
const MAP_ALPHA = 0.75;
const ZOOM_FACTOR = 1.5;
const KEY_PX = 60;

export function mountLargeTrack(host: HTMLElement, deps: Deps): Panel {
  const canvas = el("canvas", {
    tabindex: "0",
    role: "img",
    "aria-label": TEXT.trackHelp,
  });
  const [fix, where] = [new LiveText(), new LiveText()];
  const key = el("ul", { class: "track-key flex-wrap mid text-xs", "aria-label": TEXT.fixTypes });
  const tools = el("div", { class: "track-tools" });
  host.append(
    el("p", { class: "track-summary mid text-sm" }, el("b", {}, fix.node), " ", where.node),
    el("div", { class: "track-box" }, canvas, tools),
    key,
  );
  let kept: TrackView | undefined; // the user's choice
  let shown: TrackView | undefined; // the view as drawn
  let due = true;
  const to = surface(canvas, () => (due = true));
  const change = (next: TrackView | undefined): void => {
    kept = next;
    due = true;
  };
  const zoom = (factor: number, u = to.width() / 2, v = to.height() / 2): void => {
    if (shown) change(zoomedTrack(shown, factor, u, v, to.width(), to.height()));
  };
  const move = (du: number, dv: number): void => {
    if (shown) change({ ...shown, middle: [shown.middle[0] - du / shown.scale, shown.middle[1] + dv / shown.scale] });
  };
  const actions: readonly (readonly [label: string, help: string, act: () => void])[] = [
    ["+", TEXT.zoomIn, () => zoom(ZOOM_FACTOR)],
    ["−", TEXT.zoomOut, () => zoom(1 / ZOOM_FACTOR)],
    [TEXT.fit, TEXT.fitHint, () => change(undefined)],
  ];
  for (const [label, help, act] of actions) {
    const button = el("button", { type: "button", class: "btn edge", title: help, "aria-label": help }, label);
    button.addEventListener("click", act);
    tools.append(button);
  }
  const map = mountMap(host.querySelector<HTMLElement>(".track-box")!, tools, to, () => (due = true));
  listen(canvas, move, zoom, () => change(undefined));
  const tick = throttle(10);
  let kinds = "";
  return {
    update(now) {
      if (!tick(now) && !due) return;
      due = false;
      const position = positionOf(channelsOf(deps));
      if (!position) return;
      const at = reading(deps);
      const i = sampleAt(position.channel, at);
      const { points, here, origin } = pathOf(position, at, i, MAX_POINTS);
      shown = drawTrack(to, points, here, kept, origin && map.under(origin));
      map.drawn();
      fix.set(fixLine(position, i) || NONE);
      const { ring } = position.channel;
      const [lat, lon] = i < 0 ? [NaN, NaN] : [ring.value(position.lat, i), ring.value(position.lon, i)];
      where.set(isPlace(lat, lon) ? `${geographic(lat)}°, ${geographic(lon)}°` : TEXT.noPosition);
      const found = [...new Set(stretches(points).map(({ quality }) => quality))];
      if (found.join() !== kinds) {
        kinds = found.join();
        key.replaceChildren(...found.map((quality) => el("li", {}, el("i", { class: quality }), STYLES[quality].word)));
      }
    },
    dispose() {
      to.dispose();
      host.replaceChildren();
    },
  };
}

interface MapUnder {
  /** Draws the ground under a track whose grid begins at `origin`; undefined for the plain grid. */
  under(origin: Origin): Ground | undefined;
  /** Requests missing tiles. */
  drawn(): void;
}

/** The map, its switch and its attribution; absent unless a tile server is configured. */
function mountMap(box: HTMLElement, tools: HTMLElement, to: Surface, changed: () => void): MapUnder {
  const book = new TileCache(changed);
  const [words, credit] = [new LiveText(), new LiveText()];
  let shown = false;
  void api.map().then((outcome) => {
    if (!outcome.ok || !outcome.value.tiles) return;
    shown = true;
    const button = el(
      "button",
      { type: "button", class: "btn edge", "aria-pressed": "true", title: TEXT.mapLabel },
      TEXT.map,
    );
    button.addEventListener("click", () => {
      shown = !shown;
      button.setAttribute("aria-pressed", String(shown));
      changed();
    });
    tools.append(button);
    credit.set(outcome.value.attribution);
    box.append(el("p", { class: "attribution mid" }, el("span", { class: "tagless" }, words.node), " ", credit.node));
    changed();
  });
  const draw =
    (origin: Origin): Ground =>
    (view, place) => {
      const x = to.context;
      let drawn = 0;
      x.globalAlpha = MAP_ALPHA;
      for (const tile of tilesUnder(view, origin, to.width(), to.height())) {
        const image = book.get(tile);
        if (!image) continue;
        const [[left, top], [right, bottom]] = [place(tile.northWest), place(tile.southEast)];
        x.drawImage(image, left, top, right - left + 0.5, bottom - top + 0.5); // half a pixel more: no seams
        drawn += 1;
      }
      x.globalAlpha = 1;
      words.set(book.failed > 0 && drawn === 0 ? TEXT.tileServerDown : "");
      return drawn > 0;
    };
  return { under: (origin) => (shown ? draw(origin) : undefined), drawn: () => book.fetch() };
}

/** Pointer, wheel and keys on the picture. */
function listen(
  canvas: HTMLCanvasElement,
  move: (du: number, dv: number) => void,
  zoom: (factor: number, u?: number, v?: number) => void,
  fit: () => void,
): void {
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    if (canvas.hasPointerCapture(event.pointerId)) move(event.movementX, event.movementY);
  });
  canvas.addEventListener("dblclick", fit);
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      zoom(Math.exp(-event.deltaY / 400), event.offsetX, event.offsetY);
    },
    { passive: false },
  );
  const keys: Readonly<Record<string, () => void>> = {
    ArrowLeft: () => move(KEY_PX, 0),
    ArrowRight: () => move(-KEY_PX, 0),
    ArrowUp: () => move(0, KEY_PX),
    ArrowDown: () => move(0, -KEY_PX),
    "+": () => zoom(ZOOM_FACTOR),
    "=": () => zoom(ZOOM_FACTOR),
    "-": () => zoom(1 / ZOOM_FACTOR),
    "0": fit,
  };
  canvas.addEventListener("keydown", (event) => {
    const act = keys[event.key];
    if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    act();
  });
}
