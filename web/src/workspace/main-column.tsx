/** The middle of the page: attitude, plots, and whatever else was put there, as the tiles of the layout. */
import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useLayoutEffect, useRef } from "preact/hooks";
import type { App, Deps } from "../page/context";
import type { PanelDefinition } from "../panels/registry";
import type { Panel } from "../ui/dom/dom";
import { mountPanel, PanelHost } from "../panels/panel-host";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/workspace";
import { usePhone } from "../ui/controls/use-phone";
import { Divider } from "./divider";
import { HEIGHT, type Layout, setHeight, setShares, treeOf } from "../data/layout";
import { leaves, type Wish } from "../data/tiles";
import { PanelHead } from "./panel-head";
import { panelsOf } from "./panels";
import { arrangement, type Box, type Seam } from "./rectangles";
import { sessionOf, type WorkspaceSession } from "./session";

interface Props {
  readonly app: App;
  readonly deps: Deps;
  readonly mountPlots: (host: HTMLElement) => Panel;
  /** Bands over the plots. */
  readonly children?: ComponentChildren;
  readonly under?: ComponentChildren;
}

/** Heights of the attitude, and of another panel that has no height of its own, px. */
const ATTITUDE: Wish = { height: 212, least: 104 };
const PANEL_PX = { usual: 260, high: 360, higher: 420 } as const;
const LEAST_PX = 120;

function wishes(layout: Layout, panels: readonly PanelDefinition[], plots: Wish) {
  return (id: string): Wish => {
    const chosen = layout.panels[id]?.height;
    if (id === "plots") return plots;
    if (chosen !== undefined) return { height: chosen, least: chosen };
    if (id === "attitude") return ATTITUDE;
    return { height: PANEL_PX[panels.find((panel) => panel.id === id)?.height ?? "usual"], least: LEAST_PX };
  };
}

export function MainColumn({ app, deps, mountPlots, children, under }: Props) {
  const session = sessionOf(app, deps.viewState);
  const all = panelsOf(deps);
  const layout = deps.viewState.layout.value;
  const tree = treeOf(layout, all);
  const host = useRef<HTMLDivElement>(null);
  const room = useSignal<readonly [width: number, height: number]>([0, 0]);
  const isPhone = usePhone();
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
  }, [room]);
  const placed = arrangement(tree, ...room.value, wishes(layout, all, deps.viewState.plotsWish.value));
  const styleOf = (box: Box | undefined): Record<string, string> =>
    isPhone || box === undefined ? {} : Object.fromEntries(Object.entries(box).map(([side, px]) => [side, `${px}px`]));
  const shown = leaves(tree).flatMap((id) => all.filter((panel) => panel.id === id));
  return (
    <div class="tiles" ref={host}>
      {shown.map((panel) => (
        <div
          class={`tile ${panel.id === "plots" ? "of-plots" : ""}`}
          key={panel.id}
          style={styleOf(placed.boxes.get(panel.id))}
        >
          {panel.id === "plots" ? (
            <>
              {children}
              <div
                class={`plots ${layout.maximised === panel.id ? "maximised" : ""}`}
                id="plots"
                data-panel="plots"
                tabIndex={-1}
              >
                <PanelHost class="plot-host flex-column" label={COMMON.plots} mount={mountPlots} />
              </div>
              {under}
            </>
          ) : (
            <MainPanel deps={deps} panel={panel} />
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
  const sized = [before, after].find((part) => typeof part === "string" && part !== "plots");
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

function MainPanel({ deps, panel }: { readonly deps: Deps; readonly panel: PanelDefinition }) {
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
      <PanelHead panel={panel} caption={caption} />
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
