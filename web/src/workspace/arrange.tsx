/**
 * Arranging: a list of the panels, by area, beside the page that changes with it. Rows are dragged, moved by buttons, sent to another
 * area, hidden and maximised. A maximised panel has a button that gives it its place back.
 */
import { useEffect, useRef } from "preact/hooks";
import { Slot } from "../extension/extension";
import type { App, Deps } from "../page/context";
import type { PanelDefinition } from "../panels/registry";
import { Button } from "../ui/controls/button";
import { Select } from "../ui/controls/choices";
import { IconButton } from "../ui/controls/icon-button";
import { Icon, type IconName } from "../ui/controls/icons";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/workspace";
import { type Area, AREAS, DEFAULT_LAYOUT, inArea, isShown, maximise, moveBy, moveTo, show } from "../data/layout";
import { isPlotsTile, panelsOf } from "./panels";
import { sessionOf, type WorkspaceSession } from "./session";
import {
  DEFAULT_ORDER,
  heightOf,
  inTile,
  movedTo,
  PLOT_HEIGHT,
  PLOTS_TILE,
  tileOf,
  withHeight,
} from "../data/plot-order";
import { placePlot } from "./tile-grip";
import type { PlotSpec } from "../data/view";

interface Props {
  readonly app: App;
  readonly deps: Deps;
}

export function ArrangeTools({ app, deps }: Props) {
  const session = sessionOf(app, deps.viewState);
  const { maximised } = deps.viewState.layout.value;
  return (
    <>
      {maximised !== undefined && (
        <Button
          look="edge restore-panel"
          icon="close"
          words={TEXT.restore}
          onClick={() => session.change((layout) => maximise(layout, undefined))}
        />
      )}
      {!session.arranging.value && session.problems.value.length > 0 && (
        <div class="workspace-note text-sm" role="alert">
          {session.problems.value.map((text) => (
            <p key={text}>{text}</p>
          ))}
          <Button look="edge" words={COMMON.close} onClick={() => (session.problems.value = [])} />
        </div>
      )}
      {session.arranging.value && <ArrangeSheet session={session} deps={deps} />}
    </>
  );
}

function ArrangeSheet({ session, deps }: { readonly session: WorkspaceSession; readonly deps: Deps }) {
  const ref = useRef<HTMLElement>(null);
  useEffect(() => ref.current?.focus(), []);
  void session.steps.value;
  const all = panelsOf(deps);
  const { plotOrder } = deps.viewState;
  const layout = deps.viewState.layout.value;
  const hidden = all.filter((panel) => !isShown(layout, panel));
  const tool = (icon: IconName, label: string, act: () => void, disabled = false) => (
    <IconButton icon={icon} label={label} disabled={disabled} onClick={act} />
  );
  return (
    <section class="arrange" ref={ref} tabIndex={-1} role="dialog" aria-modal="false" aria-label={TEXT.sheet}>
      <div class="head">
        <h2>{TEXT.sheet}</h2>
        <span class="grow" />
        {tool("undo", TEXT.undo, session.undo, !session.history.canUndo)}
        {tool("redo", TEXT.redo, session.redo, !session.history.canRedo)}
        {tool("close", TEXT.done, () => (session.arranging.value = false))}
      </div>
      <div class="arrange-lists">
        <Slot name="workspaceSheet" with={{ session, deps }} />
        {AREAS.map((area) => (
          <AreaList key={area} session={session} area={area} all={all} panels={inArea(layout, area, all)} />
        ))}
        <PlotList session={session} deps={deps} all={all} />
        {hidden.length > 0 && <AreaList session={session} area="hidden" all={all} panels={hidden} />}
      </div>
      <div class="arrange-foot">
        <Button
          look="edge"
          words={TEXT.defaultLayout}
          disabled={layout === DEFAULT_LAYOUT && plotOrder.value === DEFAULT_ORDER}
          onClick={() => {
            session.change(() => {
              plotOrder.value = DEFAULT_ORDER;
              return DEFAULT_LAYOUT;
            });
          }}
        />
        <span class="grow" />
        <Button look="main" words={TEXT.done} onClick={() => (session.arranging.value = false)} />
      </div>
    </section>
  );
}

type Place = Area | "hidden";

interface ListProps {
  readonly session: WorkspaceSession;
  readonly area: Place;
  readonly all: readonly PanelDefinition[];
  readonly panels: readonly PanelDefinition[];
}

function AreaList({ session, area, all, panels }: ListProps) {
  return (
    <>
      <h3>{TEXT.areas[area]}</h3>
      <ul data-area={area}>
        {panels.length === 0 && <li class="none">{COMMON.none}</li>}
        {panels.map((panel, k) => (
          <Row
            key={panel.id}
            session={session}
            panel={panel}
            area={area}
            all={all}
            isFirst={k === 0}
            isLast={k === panels.length - 1}
          />
        ))}
      </ul>
    </>
  );
}

interface RowProps extends Omit<ListProps, "panels"> {
  readonly panel: PanelDefinition;
  readonly isFirst: boolean;
  readonly isLast: boolean;
}

function placed(session: WorkspaceSession, panel: PanelDefinition, all: RowProps["all"], to: Place, at?: number): void {
  session.change((layout) =>
    to === "hidden" ? show(layout, panel, false) : moveTo(show(layout, panel, true), panel, to, all, at),
  );
}

const placesOf = ({ id, isWide }: PanelDefinition): readonly Place[] =>
  isPlotsTile(id) ? ["main"] : isWide ? ["main", "hidden"] : [...AREAS, "hidden"];

function Row({ session, panel, area, all, isFirst, isLast }: RowProps) {
  const places = placesOf(panel);
  const step = (steps: number) => () => session.change((layout) => moveBy(layout, panel, steps, all));
  return (
    <li data-row={panel.id}>
      <span class="grip" aria-hidden="true" onPointerDown={(event) => drag(event, session, panel, all)}>
        <Icon name="grip" />
      </span>
      <b class="ellipsis">{panel.title}</b>
      {area !== "hidden" && (
        <>
          <IconButton icon="up" label={TEXT.moveUp(panel.title)} disabled={isFirst} onClick={step(-1)} />
          <IconButton icon="down" label={TEXT.moveDown(panel.title)} disabled={isLast} onClick={step(1)} />
          <IconButton
            icon="fit"
            label={TEXT.maximise(panel.title)}
            onClick={() => {
              session.arranging.value = false;
              session.change((layout) => maximise(layout, panel.id));
            }}
          />
        </>
      )}
      {area === "hidden" ? (
        <Button
          look="edge"
          words={TEXT.show}
          aria-label={TEXT.showPanel(panel.title)}
          onClick={() => placed(session, panel, all, homeOf(session, panel))}
        />
      ) : (
        <Select
          label={TEXT.placeOf(panel.title)}
          value={area}
          options={places.map((place) => [place, TEXT.places[place]])}
          disabled={places.length === 1}
          onChoose={(place) => placed(session, panel, all, place)}
        />
      )}
    </li>
  );
}

const homeOf = (session: WorkspaceSession, { id, where }: PanelDefinition): Area =>
  session.view.viewState.layout.peek().panels[id]?.area ?? (where as Area);

/** Drag a row to another place of the list. */
function drag(event: PointerEvent, session: WorkspaceSession, panel: PanelDefinition, all: RowProps["all"]): void {
  const grip = event.currentTarget;
  if (!(grip instanceof HTMLElement) || event.button !== 0) return;
  event.preventDefault();
  grip.setPointerCapture(event.pointerId);
  const row = grip.closest("li");
  row?.classList.add("dragged");
  let over: { readonly place: Place; readonly at: number } | undefined;
  let marked: Element | null = null;
  const mark = (element: Element | null): void => {
    marked?.classList.remove("drop-before");
    marked = element;
    marked?.classList.add("drop-before");
  };
  const move = (to: PointerEvent): void => {
    const below = document.elementFromPoint(to.clientX, to.clientY);
    const list = below?.closest("ul[data-area]");
    const place = list?.getAttribute("data-area") as Place | null | undefined;
    if (!list || !place || !placesOf(panel).includes(place)) {
      over = undefined;
      return mark(null);
    }
    const rows = [...list.querySelectorAll("li[data-row]")].filter((one) => one !== row);
    const next = rows.findIndex((one) => {
      const { top, height } = one.getBoundingClientRect();
      return to.clientY < top + height / 2;
    });
    over = { place, at: next < 0 ? rows.length : next };
    mark(next < 0 ? list : (rows[next] ?? null));
  };
  const end = (last: PointerEvent): void => {
    for (const [name, act] of [
      ["pointermove", move],
      ["pointerup", end],
      ["pointercancel", end],
    ] as const)
      grip.removeEventListener(name, act);
    row?.classList.remove("dragged");
    mark(null);
    if (over && last.type === "pointerup") placed(session, panel, all, over.place, over.at);
  };
  grip.addEventListener("pointermove", move);
  grip.addEventListener("pointerup", end);
  grip.addEventListener("pointercancel", end);
}

/** The button in the bar, and at the end of the page on a phone. */
export function ArrangeButton({ app, deps, words = false }: Props & { readonly words?: boolean }) {
  const { arranging } = sessionOf(app, deps.viewState);
  return (
    <button
      type="button"
      class={words ? "btn edge phone arrange-phone" : "btn icon worded desk arrange-button"}
      aria-pressed={arranging.value}
      {...(words ? {} : { "aria-label": TEXT.sheet })}
      title={TEXT.sheetHint}
      onClick={() => (arranging.value = !arranging.value)}
    >
      <Icon name="grid" />
      {words ? TEXT.sheet : <span class="icon-word">{TEXT.sheet}</span>}
    </button>
  );
}

/** A press changes the height by this, px. */
const STEP_PX = 24;

function PlotList({
  session,
  deps: { store, viewState },
  all,
}: Pick<RowProps, "session" | "all"> & { readonly deps: Deps }) {
  const { plotOrder, actions, customPlots, extraPlots, device } = viewState;
  void [store.channels.value, customPlots.value, extraPlots.value, device.value];
  const of = plotOrder.value;
  const plots = actions.plots();
  const keys = plots.map(({ key }) => key);
  if (plots.length < 1) return null;
  const tool = (icon: IconName, label: string, isDisabled: boolean, act: () => void) => (
    <IconButton icon={icon} label={label} disabled={isDisabled} onClick={act} />
  );
  const size = ({ key }: PlotSpec, steps: number): void => {
    const now = heightOf(of, key) ?? document.querySelector(`.plot[data-key="${CSS.escape(key)}"]`)?.clientHeight;
    plotOrder.value = withHeight(of, key, (now ?? PLOT_HEIGHT[0]) + steps * STEP_PX);
  };
  return (
    <>
      <h3>{COMMON.plots}</h3>
      <ul class="plot-list">
        {plots.map((plot, k) => {
          const { key, title } = plot;
          const height = heightOf(of, key);
          const shown = height === undefined ? TEXT.automatic : TEXT.pixels(height);
          const move = (to: number) => () => (plotOrder.value = movedTo(of, keys, key, to));
          return (
            <li key={key} data-plot-row={key}>
              <b class="ellipsis">{title}</b>
              {tool("up", TEXT.moveUp(title), k === 0, move(k - 1))}
              {tool("down", TEXT.moveDown(title), k === plots.length - 1, move(k + 1))}
              {tileOf(of, key) === PLOTS_TILE
                ? tool("side", TEXT.ownTile(title), plots.length < 2, () =>
                    placePlot(session, key, { target: PLOTS_TILE, edge: "right" }, all),
                  )
                : tool("close", TEXT.backToPlots(title), false, () => (plotOrder.value = inTile(of, key, PLOTS_TILE)))}
              {tool("minus", TEXT.lower(title), (height ?? Infinity) <= PLOT_HEIGHT[0], () => size(plot, -1))}
              {tool("plus", TEXT.taller(title), (height ?? 0) >= PLOT_HEIGHT[1], () => size(plot, 1))}
              <Button
                look="edge"
                words={shown}
                aria-label={TEXT.automaticHeightOf(shown, title)}
                disabled={height === undefined}
                onClick={() => (plotOrder.value = withHeight(of, key, undefined))}
              />
            </li>
          );
        })}
      </ul>
    </>
  );
}
