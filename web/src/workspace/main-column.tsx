/** The middle of the page: attitude, plots, and whatever else was put there, as the tiles of the layout. */
import { useSignal } from "@preact/signals";
import type { ComponentChildren, RefObject } from "preact";
import { useLayoutEffect, useRef } from "preact/hooks";
import type { App, Deps } from "../page/context";
import type { PanelDefinition } from "../panels/registry";
import type { Panel } from "../ui/dom/dom";
import { mountPanel, PanelHost } from "../panels/panel-host";
import { TEXT } from "../texts/workspace";
import { IconButton } from "../ui/controls/icon-button";
import { usePhone } from "../ui/controls/use-phone";
import { Divider } from "./divider";
import { HEIGHT, type Layout, setHeight, setShares, show, treeOf } from "../data/layout";
import { PLOTS_TILE } from "../data/plot-order";
import { leaves, type Wish } from "../data/tiles";
import type { StackDeps } from "../plots/plot-stack";
import { PanelHead } from "./panel-head";
import { isPlotsTile, panelsOf } from "./panels";
import { arrangement, type Box, type Seam } from "./rectangles";
import { sessionOf, type WorkspaceSession } from "./session";
import { dragPlots, TileGrip } from "./tile-grip";

interface Props {
  readonly app: App;
  readonly deps: Deps;
  readonly mountPlots: (host: HTMLElement, tile: Required<Pick<StackDeps, "tile" | "dragOut">>) => Panel;
  /** Bands over the plots. */
  readonly children?: ComponentChildren;
  readonly under?: ComponentChildren;
}

/** Tiles under this width have their parts below each other, px. */
const NARROW_PX = 520;
const isNarrow = (box: Box | undefined): boolean => box !== undefined && box.width < NARROW_PX;

/** Heights of the attitude, and of another panel that has no height of its own, px. */
const ATTITUDE: Wish = { height: 212, least: 104 };
const PANEL_PX = { usual: 260, high: 360, higher: 420 } as const;
const LEAST_PX = 240;

function wishes(layout: Layout, panels: readonly PanelDefinition[], plots: Wish) {
  return (id: string): Wish => {
    const chosen = layout.panels[id]?.height;
    if (id === PLOTS_TILE) return plots;
    if (isPlotsTile(id)) return { height: 2 * ATTITUDE.height, least: 128, grows: true };
    if (chosen !== undefined) return { height: chosen, least: chosen };
    if (id === "attitude") return ATTITUDE;
    return { height: PANEL_PX[panels.find((panel) => panel.id === id)?.height ?? "usual"], least: LEAST_PX };
  };
}

/** Width and height inside an element, px; follows them. Known before the first paint. */
function useRoom(host: RefObject<HTMLElement | null>): readonly [width: number, height: number] {
  const room = useSignal<readonly [width: number, height: number]>([0, 0]);
  useLayoutEffect(() => {
    const box = host.current;
    if (!box) return undefined;
    const measure = (): void => {
      if (box.clientWidth !== room.peek()[0] || box.clientHeight !== room.peek()[1])
        room.value = [box.clientWidth, box.clientHeight];
    };
    const watch = new ResizeObserver(measure);
    watch.observe(box);
    measure();
    return () => watch.disconnect();
  }, [host, room]);
  return room.value;
}

export function MainColumn({ app, deps, mountPlots, children, under }: Props) {
  const session = sessionOf(app, deps.viewState);
  const all = panelsOf(deps);
  const layout = deps.viewState.layout.value;
  const tree = treeOf(layout, all);
  const host = useRef<HTMLDivElement>(null);
  const isPhone = usePhone();
  const placed = arrangement(tree, ...useRoom(host), wishes(layout, all, deps.viewState.plotsWish.value));
  const styleOf = (box: Box | undefined): Record<string, string> =>
    isPhone || box === undefined ? {} : Object.fromEntries(Object.entries(box).map(([side, px]) => [side, `${px}px`]));
  const shown = leaves(tree).flatMap((id) => all.filter((panel) => panel.id === id));
  return (
    <div class="tiles" ref={host}>
      {shown.map((panel) => (
        <div
          class={`tile ${isPlotsTile(panel.id) ? "of-plots" : ""} ${isNarrow(placed.boxes.get(panel.id)) ? "narrow" : ""}`}
          key={panel.id}
          data-tile={panel.id}
          style={styleOf(placed.boxes.get(panel.id))}
        >
          {(isPlotsTile(panel.id) || panel.id === "attitude") && shown.length > 1 && (
            <TileGrip session={session} panel={panel} all={all} />
          )}
          {isPlotsTile(panel.id) ? (
            <>
              {panel.id === PLOTS_TILE && children}
              <div
                class={`plots ${layout.maximised === panel.id ? "maximised" : ""}`}
                id={panel.id.replace("/", "-")}
                data-panel={panel.id}
                tabIndex={-1}
              >
                <PanelHost
                  class="plot-host flex-column"
                  label={panel.title}
                  mount={(host) =>
                    mountPlots(host, { tile: panel.id, dragOut: dragPlots(session, panel.id, () => panelsOf(deps)) })
                  }
                />
              </div>
              {panel.id === PLOTS_TILE && under}
            </>
          ) : (
            <MainPanel session={session} deps={deps} panel={panel} all={all} />
          )}
        </div>
      ))}
      {!isPhone &&
        placed.seams.map((seam) => (
          <SeamLine
            key={`${seam.path.join(".")}/${seam.after}`}
            seam={seam}
            session={session}
            all={all}
            style={styleOf(seam.box)}
          />
        ))}
    </div>
  );
}

interface SeamProps {
  readonly seam: Seam;
  readonly session: WorkspaceSession;
  readonly all: readonly PanelDefinition[];
  readonly style: Record<string, string>;
}

/** The line between two tiles, which sets their sizes. */
function SeamLine({ seam, session, all, style }: SeamProps) {
  const layout = session.view.viewState.layout.peek();
  const split = seam.path.reduce((of, k) => (of.parts[k] as typeof of) ?? of, treeOf(layout, all));
  const [before, after] = [split.parts[seam.after], split.parts[seam.after + 1]];
  const nameOf = (part: typeof before): string =>
    (part === undefined ? [] : leaves(part)).map((id) => all.find((panel) => panel.id === id)?.title ?? id).join(", ");
  // In a column whose panels have the size that they ask for, a line sets the height of the panel beside the plots.
  const sized = [before, after].find((part) => typeof part === "string" && !isPlotsTile(part));
  const setsHeight =
    seam.along === "column" && split.shares === undefined && typeof sized === "string" ? sized : undefined;
  const isBefore = setsHeight === undefined || setsHeight === before;
  const [first, second] = [seam.sizes[seam.after] ?? 0, seam.sizes[seam.after + 1] ?? 0];
  const onSize = (px: number | undefined): void =>
    session.adjust((now) => {
      if (setsHeight !== undefined) return setHeight(now, setsHeight, px);
      if (px === undefined) return setShares(now, seam.path, undefined, all);
      const own = Math.min(Math.max(px, seam.limits[0]), seam.limits[1]);
      const sizes = seam.sizes.map((size, k) =>
        k === seam.after ? own : k === seam.after + 1 ? first + second - own : size,
      );
      return setShares(
        now,
        seam.path,
        sizes.map((size) => Math.max(1, Math.round(size))),
        all,
      );
    });
  return (
    <Divider
      label={seam.along === "row" ? TEXT.widthOf(nameOf(before)) : TEXT.heightOf(nameOf(isBefore ? before : after))}
      orientation={seam.along === "row" ? "vertical" : "horizontal"}
      sign={isBefore ? 1 : -1}
      limits={setsHeight === undefined ? seam.limits : HEIGHT}
      size={isBefore ? first : second}
      onSize={onSize}
      style={style}
    />
  );
}

interface PanelProps {
  readonly session: WorkspaceSession;
  readonly deps: Deps;
  readonly panel: PanelDefinition;
  readonly all: readonly PanelDefinition[];
}

function MainPanel({ session, deps, panel, all }: PanelProps) {
  const caption = useRef<HTMLSpanElement>(null);
  const isMaximised = deps.viewState.layout.value.maximised === panel.id;
  if (panel.id === "attitude")
    // its parts are laid out by the column itself on a phone, so nothing is around it
    return (
      <PanelHost
        class={`attitude ${isMaximised ? "maximised" : ""}`}
        label={panel.title}
        panel={panel.id}
        mount={(host) => panel.mount(host, deps, null)}
      />
    );
  const { after: After } = panel;
  return (
    <section class={`main-panel ${isMaximised ? "maximised" : ""}`} aria-label={panel.title} data-panel={panel.id}>
      <PanelHead panel={panel} session={session} all={all} caption={caption}>
        <span class="grow" />
        <IconButton
          icon="close"
          class="desk"
          label={TEXT.hidePanel(panel.title)}
          onClick={() => session.change((layout) => show(layout, panel, false))}
        />
      </PanelHead>
      <div class="panel-body" tabIndex={0} role="group" aria-label={panel.title}>
        <PanelHost
          {...(panel.class === undefined ? {} : { class: panel.class })}
          mount={(host) => mountPanel(panel, host, deps, caption.current)}
        />
        {After && <After deps={deps} />}
      </div>
    </section>
  );
}
