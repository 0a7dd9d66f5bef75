/**
 * The grip of a panel: dragged to an edge of another panel, of the whole middle, or into the side column; moved by the arrow keys. What
 * a drop would do is drawn while it is dragged.
 */
import { type Area, areaOf, type Layout, maximise, moveTo, show, tile } from "../data/layout";
import { freeTile, inTile, PLOTS_TILE, tileOf } from "../data/plot-order";
import { type Edge, EDGES } from "../data/tiles";
import type { DragOut } from "../plots/plot-grips";
import type { PanelDefinition } from "../panels/registry";
import { TEXT } from "../texts/workspace";
import { Icon } from "../ui/controls/icons";
import { isPlotsTile, plotsPanel } from "./panels";
import type { WorkspaceSession } from "./session";

interface Props {
  readonly session: WorkspaceSession;
  readonly panel: PanelDefinition;
  readonly all: readonly PanelDefinition[];
}

/** Where a panel goes. `target` is a panel of the middle, or undefined for the whole middle. */
export type Drop =
  | { readonly target: string | undefined; readonly edge: Edge }
  | { readonly area: Area; readonly at: number };

/** A drop this close to the border of the middle is beside everything, px. */
const BORDER_PX = 16;

interface Placed {
  readonly id: string;
  readonly box: DOMRect;
}

const boxesOf = (selector: string, name: string): readonly Placed[] =>
  [...document.querySelectorAll<HTMLElement>(selector)].map((one) => ({
    id: one.dataset[name] ?? "",
    box: one.getBoundingClientRect(),
  }));
const tilesNow = (): readonly Placed[] => boxesOf(".tiles > .tile", "tile");

const isWithin = ({ left, right, top, bottom }: DOMRect, x: number, y: number): boolean =>
  x >= left && x < right && y >= top && y < bottom;

/** The edge of a box that is nearest to a point, relative to its size. */
export function nearestEdge({ left, top, width, height }: Omit<DOMRect, "toJSON">, x: number, y: number): Edge {
  const [right, down] = [(x - left) / width, (y - top) / height];
  const away = { left: right, right: 1 - right, top: down, bottom: 1 - down };
  return EDGES.reduce((best, edge) => (away[edge] < away[best] ? edge : best));
}

/** What a drop at a point does; undefined: nothing. */
function dropAt(x: number, y: number, { id, isWide }: Pick<PanelDefinition, "id" | "isWide">): Drop | undefined {
  const middle = document.querySelector(".tiles")?.getBoundingClientRect();
  if (middle && isWithin(middle, x, y)) {
    const edge = nearestEdge(middle, x, y);
    const away = { left: x - middle.left, right: middle.right - x, top: y - middle.top, bottom: middle.bottom - y };
    if (away[edge] < BORDER_PX) return { target: undefined, edge };
    const over = tilesNow().find(({ box }) => isWithin(box, x, y));
    return over && over.id !== id ? { target: over.id, edge: nearestEdge(over.box, x, y) } : undefined;
  }
  const side = document.querySelector(".side");
  if (!side || isWide || !isWithin(side.getBoundingClientRect(), x, y)) return undefined;
  const lower = side.querySelector<HTMLElement>(".lower-panels");
  const area = lower && !lower.hidden && y >= lower.getBoundingClientRect().top ? "below" : "side";
  const others = boxesOf(area === "below" ? ".lower-panels > [data-panel]" : ".side > [data-panel]", "panel");
  return { area, at: others.filter((one) => one.id !== id && y > one.box.top + one.box.height / 2).length };
}

/** Where it is drawn that a panel would be. */
function boxOf(drop: Drop): Readonly<Record<"left" | "top" | "width" | "height", number>> | undefined {
  if ("area" in drop) {
    const host = document.querySelector(drop.area === "below" ? ".lower-panels" : ".side")?.getBoundingClientRect();
    const rows = boxesOf(drop.area === "below" ? ".lower-panels > [data-panel]" : ".side > [data-panel]", "panel");
    const top = rows[drop.at]?.box.top ?? rows.at(-1)?.box.bottom ?? host?.top;
    return host && top !== undefined ? { left: host.left, top: top - 2, width: host.width, height: 4 } : undefined;
  }
  const { target, edge } = drop;
  const whole = target === undefined;
  const box = whole
    ? document.querySelector(".tiles")?.getBoundingClientRect()
    : tilesNow().find(({ id }) => id === target)?.box;
  if (!box) return undefined;
  const part = whole ? 1 / 4 : 1 / 2;
  const [width, height] =
    edge === "left" || edge === "right" ? [box.width * part, box.height] : [box.width, box.height * part];
  return {
    left: edge === "right" ? box.right - width : box.left,
    top: edge === "bottom" ? box.bottom - height : box.top,
    width,
    height,
  };
}

export const dropped = (layout: Layout, panel: PanelDefinition, drop: Drop, all: readonly PanelDefinition[]): Layout =>
  "area" in drop ? moveTo(layout, panel, drop.area, all, drop.at) : tile(layout, panel, drop.target, drop.edge, all);

interface DropZone {
  /** What a drop at the pointer would do, drawn. */
  readonly over: (to: PointerEvent) => Drop | undefined;
  readonly remove: () => void;
}

/** @param accepts false for drops that do nothing */
function dropZone(
  panel: Pick<PanelDefinition, "id" | "isWide">,
  accepts: (drop: Drop) => boolean = () => true,
): DropZone {
  const zone = document.createElement("div");
  zone.className = "drop-zone";
  return {
    over({ clientX, clientY }) {
      const drop = dropAt(clientX, clientY, panel);
      const box = drop && accepts(drop) ? boxOf(drop) : undefined;
      if (!box) return void zone.remove();
      for (const [side, px] of Object.entries(box)) zone.style.setProperty(side, `${px}px`);
      if (!zone.isConnected) document.body.append(zone);
      return drop;
    },
    remove: () => zone.remove(),
  };
}

/** Follow a pointer until it is lifted, and say where it was dropped. Esc ends it without a drop. */
function dragTile(event: PointerEvent, panel: PanelDefinition, onDrop: (drop: Drop) => void): void {
  const grip = event.currentTarget;
  if (!(grip instanceof HTMLElement) || event.button !== 0) return;
  event.preventDefault();
  grip.focus({ preventScroll: true });
  grip.setPointerCapture(event.pointerId);
  const zone = dropZone(panel);
  let drop: Drop | undefined;
  const stop = new AbortController();
  const { signal } = stop;
  const end = (isDropped: boolean) => (): void => {
    stop.abort();
    zone.remove();
    if (isDropped && drop) onDrop(drop);
  };
  const onKey = (key: KeyboardEvent): void => {
    if (key.key !== "Escape") return;
    key.stopPropagation();
    end(false)();
  };
  grip.addEventListener("pointermove", (to) => void (drop = zone.over(to)), { signal });
  grip.addEventListener("pointerup", end(true), { signal });
  grip.addEventListener("pointercancel", end(false), { signal });
  addEventListener("keydown", onKey, { signal, capture: true });
}

/** Put a plot beside a tile, in one of its own; above or below other plots it joins them. */
export function placePlot(
  session: WorkspaceSession,
  key: string,
  { target, edge }: Extract<Drop, { edge: Edge }>,
  all: readonly PanelDefinition[],
): void {
  const { plotOrder, plotsWish } = session.view.viewState;
  session.change((layout) => {
    const of = plotOrder.peek();
    if (target !== undefined && isPlotsTile(target) && (edge === "top" || edge === "bottom")) {
      plotOrder.value = inTile(of, key, target);
      return layout;
    }
    const own = tileOf(of, key);
    const isAlone = own !== PLOTS_TILE && plotsWish.peek().keys.every((one) => one === key || tileOf(of, one) !== own);
    const id = isAlone ? own : freeTile(of);
    plotOrder.value = inTile(of, key, id);
    const next = plotsPanel(id);
    return tile(layout, next, target, edge, isAlone ? all : [...all, next]);
  });
}

/** Drags of plots by their titles. @param of the tile that they are dragged from */
export const dragPlots =
  (session: WorkspaceSession, of: string, all: () => readonly PanelDefinition[]): DragOut =>
  (key) => {
    let drop: Drop | undefined;
    const zone = dropZone(
      { id: "", isWide: true },
      (to) => "edge" in to && !(to.target === of && (to.edge === "top" || to.edge === "bottom")),
    );
    return {
      move: (to) => (drop = zone.over(to)) !== undefined,
      drop(isDropped) {
        zone.remove();
        if (!isDropped || !drop || !("edge" in drop)) return false;
        placePlot(session, key, drop, all());
        return true;
      },
    };
  };

const ARROWS: Readonly<Record<string, Edge>> = {
  ArrowLeft: "left",
  ArrowRight: "right",
  ArrowUp: "top",
  ArrowDown: "bottom",
};

/** The panel that lies next on a side; undefined: none. */
export function panelBeside(all: readonly Placed[], id: string, edge: Edge): string | undefined {
  const own = all.find((one) => one.id === id)?.box;
  if (!own) return undefined;
  const gap = ({ box }: Placed): number =>
    ({
      left: own.left - box.right,
      right: box.left - own.right,
      top: own.top - box.bottom,
      bottom: box.top - own.bottom,
    })[edge];
  const overlap = ({ box }: Placed): number =>
    edge === "left" || edge === "right"
      ? Math.min(own.bottom, box.bottom) - Math.max(own.top, box.top)
      : Math.min(own.right, box.right) - Math.max(own.left, box.left);
  return all
    .filter((one) => one.id !== id && gap(one) > -1 && overlap(one) > 1)
    .sort((a, b) => gap(a) - gap(b) || overlap(b) - overlap(a))[0]?.id;
}

/**
 * A step of the arrow keys: past the panel on that side; without one, beside the panel before or after it; if it is there already,
 * beside everything.
 */
function stepped(layout: Layout, panel: PanelDefinition, edge: Edge, all: readonly PanelDefinition[]): Layout {
  const placed = tilesNow();
  const at = placed.findIndex(({ id }) => id === panel.id);
  const target = panelBeside(placed, panel.id, edge) ?? placed[at === 0 ? 1 : at - 1]?.id;
  if (at < 0 || target === undefined) return tile(layout, panel, undefined, edge, all);
  const next = tile(layout, panel, target, edge, all);
  const isSame = JSON.stringify(next.tiles) === JSON.stringify(layout.tiles);
  return isSame ? tile(layout, panel, undefined, edge, all) : next;
}

export function TileGrip({ session, panel, all }: Props) {
  const onKeyDown = (event: KeyboardEvent): void => {
    const edge = ARROWS[event.key];
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (edge) session.change((layout) => stepped(layout, panel, edge, all));
    else if (event.key === "Enter") session.toggleMaximised(panel.id);
    else if (event.key === "Delete" && !isPlotsTile(panel.id)) session.change((layout) => show(layout, panel, false));
    else if (event.key.toLowerCase() === "s" && !panel.isWide)
      session.change((layout) =>
        moveTo(maximise(layout, undefined), panel, areaOf(layout, panel) === "side" ? "main" : "side", all),
      );
    else return;
    event.preventDefault();
    event.stopPropagation();
    const { id } = panel;
    requestAnimationFrame(() => document.querySelector<HTMLElement>(`[data-grip="${CSS.escape(id)}"]`)?.focus());
  };
  return (
    <button
      type="button"
      class="tile-grip desk"
      data-grip={panel.id}
      aria-label={TEXT.movePanel(panel.title)}
      title={TEXT.movePanelHint}
      onPointerDown={(event) =>
        dragTile(event, panel, (drop) => session.change((layout) => dropped(layout, panel, drop, all)))
      }
      onKeyDown={onKeyDown}
    >
      <Icon name="grip" />
    </button>
  );
}
