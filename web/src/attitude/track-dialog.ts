/**
 * The track, large: on a metric grid with scale bar and north, drag to move, wheel or buttons to zoom, the arrow keys and
 * + − 0 by keyboard. It follows the window until a person moves it; `Fit` makes it follow again. Where a tile server is configured,
 * a map lies under it, which can be switched off.
 */
import { channelsOf, type Deps, reading, sampleAt } from "../panels/panel-context";
import { type Surface, surface } from "../ui/canvas";
import { el, every, Live, type Panel } from "../ui/dom";
import { geographic, NONE } from "../ui/format";
import { api } from "../ui/http";
import { pathOf } from "./path";
import { fixLine, isPlace, positionOf } from "./position";
import { drawTrack, type Ground, STYLES, stretches, type TrackView, zoomed } from "./track";
import { type Origin, TileBook, tilesUnder } from "./tiles";

const POINTS = 4000;
/** So strong is a map: the track is what is looked at. */
const MAP_ALPHA = 0.75;
const ZOOM = 1.5;
const KEY_PX = 60;

/** Mounts into `host`. */
export function mountLargeTrack(host: HTMLElement, deps: Deps): Panel {
  const canvas = el("canvas", { tabindex: "0", role: "img", "aria-label": "Track on a metric grid, north up. Arrow keys move it, plus and minus zoom, 0 fits." });
  const [fix, where] = [new Live(), new Live()];
  const key = el("ul", { class: "trackkey", "aria-label": "Kinds of fix" });
  const tools = el("div", { class: "tracktools" });
  host.append(el("p", { class: "trackline" }, el("b", {}, fix.node), " ", where.node), el("div", { class: "trackbox" }, canvas, tools), key);
  let kept: TrackView | undefined; // what a person chose
  let shown: TrackView | undefined; // what is drawn
  let due = true;
  const to = surface(canvas, () => (due = true));
  const change = (next: TrackView | undefined): void => {
    kept = next;
    due = true;
  };
  const zoom = (factor: number, u = to.width() / 2, v = to.height() / 2): void => {
    if (shown) change(zoomed(shown, factor, u, v, to.width(), to.height()));
  };
  const move = (du: number, dv: number): void => {
    if (shown) change({ ...shown, middle: [shown.middle[0] - du / shown.scale, shown.middle[1] + dv / shown.scale] });
  };
  const actions: readonly (readonly [label: string, help: string, act: () => void])[] = [
    ["+", "Zoom in", () => zoom(ZOOM)],
    ["−", "Zoom out", () => zoom(1 / ZOOM)],
    ["Fit", "Fit: show all of the window, and follow it", () => change(undefined)],
  ];
  for (const [label, help, act] of actions) {
    const button = el("button", { type: "button", class: "btn edge", title: help, "aria-label": help }, label);
    button.addEventListener("click", act);
    tools.append(button);
  }
  const map = mountMap(host.querySelector<HTMLElement>(".trackbox")!, tools, to, () => (due = true));
  listen(canvas, move, zoom, () => change(undefined));
  const tick = every(10);
  let kinds = "";
  return {
    update(now) {
      if (!tick(now) && !due) return;
      due = false;
      const position = positionOf(channelsOf(deps));
      if (!position) return;
      const at = reading(deps);
      const i = sampleAt(position.channel, at);
      const { points, here, origin } = pathOf(position, at, i, POINTS);
      shown = drawTrack(to, points, here, kept, origin && map.under(origin));
      map.drawn();
      fix.set(fixLine(position, i) || NONE);
      const { ring } = position.channel;
      const [lat, lon] = i < 0 ? [NaN, NaN] : [ring.value(position.lat, i), ring.value(position.lon, i)];
      where.set(isPlace(lat, lon) ? `${geographic(lat)}°, ${geographic(lon)}°` : "no position");
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
  /** What is drawn under a track whose grid begins at `origin`; undefined for the plain grid. */
  under(origin: Origin): Ground | undefined;
  /** Asks for the tiles that were missing. */
  drawn(): void;
}

/** The map, its switch and its attribution; nothing of it unless a tile server is configured. */
function mountMap(box: HTMLElement, tools: HTMLElement, to: Surface, changed: () => void): MapUnder {
  const book = new TileBook(changed);
  const [words, credit] = [new Live(), new Live()];
  let shown = false;
  void api.map().then((outcome) => {
    if (!outcome.ok || !outcome.value.tiles) return;
    shown = true;
    const button = el("button", { type: "button", class: "btn edge", "aria-pressed": "true", title: "Map under the track" }, "Map");
    button.addEventListener("click", () => {
      shown = !shown;
      button.setAttribute("aria-pressed", String(shown));
      changed();
    });
    tools.append(button);
    credit.set(outcome.value.attribution);
    box.append(el("p", { class: "attribution" }, el("span", { class: "tagless" }, words.node), " ", credit.node));
    changed();
  });
  const draw = (origin: Origin): Ground => (view, place) => {
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
    words.set(book.failed > 0 && drawn === 0 ? "The tile server does not answer." : "");
    return drawn > 0;
  };
  return { under: (origin) => (shown ? draw(origin) : undefined), drawn: () => book.fetch() };
}

/** Pointer, wheel and keys on the picture. */
function listen(canvas: HTMLCanvasElement, move: (du: number, dv: number) => void, zoom: (factor: number, u?: number, v?: number) => void, fit: () => void): void {
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
    "+": () => zoom(ZOOM),
    "=": () => zoom(ZOOM),
    "-": () => zoom(1 / ZOOM),
    "0": fit,
  };
  canvas.addEventListener("keydown", (event) => {
    const act = keys[event.key];
    if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    act();
  });
}
