/** The registered panels beside the plots (panels/registry.ts), of Live and of an open recording. */
import { useRef } from "preact/hooks";
import "../panels/all";
import { type PanelDefinition, panelsAt } from "../panels/registry";
import { IconButton } from "../ui/icon-button";
import type { Panel } from "../ui/dom";
import { PanelHost } from "../ui/panel-host";
import type { Deps } from "../panels/panel-context";
import type { App } from "./app-state";
import { ArrangeButton } from "../workspace/arrange";
import { Divider } from "../workspace/divider";
import { HEIGHT, setHeight, setSize, SIDE_WIDTH } from "../workspace/layout";
import { PanelHead } from "../workspace/panel-head";
import { panelsHere } from "../workspace/panels";
import { sessionOf, type WorkspaceSession } from "../workspace/session";
import { TEXT } from "../texts/live";
import { TEXT as WORKSPACE } from "../texts/workspace";

interface Props {
  /** Context of the panels: the page itself on Live, a recording otherwise. */
  readonly deps: Deps;
}

/** The panels over the plots if the side column has no room. */
export function Strip({ deps }: Props) {
  return (
    <>
      {panelsAt("strip", deps).map((panel) => (
        <PanelHost
          key={panel.id}
          class={panel.class ?? ""}
          label={panel.title}
          scrolls
          mount={(host) => panel.mount(host, deps, null)}
        />
      ))}
    </>
  );
}

export function SideColumn({ app, deps }: Props & { readonly app: App }) {
  const session = sessionOf(app, deps.viewState);
  const { sideWidth, belowHeight } = deps.viewState.layout.value;
  const below = panelsHere("below", deps);
  const isArranging = session.arranging.value;
  return (
    <aside class={`side ${app.sheet.value === "side" ? "open" : ""}`} id="side" aria-label={TEXT.valuesAndHealth}>
      {isArranging && (
        <Divider
          label={WORKSPACE.sideWidth}
          orientation="vertical"
          sign={-1}
          target={(handle) => handle.parentElement}
          limits={SIDE_WIDTH}
          size={sideWidth}
          onSize={(px) => session.adjust((layout) => setSize(layout, "sideWidth", px))}
        />
      )}
      {panelsHere("side", deps).map((panel, k) => (
        <SidePanel key={panel.id} session={session} panel={panel} deps={deps} folds={k === 0 ? app : undefined} />
      ))}
      {isArranging && below.length > 0 && (
        <Divider
          label={WORKSPACE.belowHeight}
          orientation="horizontal"
          sign={-1}
          target={(handle) => handle.nextElementSibling}
          limits={HEIGHT}
          size={belowHeight}
          onSize={(px) => session.adjust((layout) => setSize(layout, "belowHeight", px))}
        />
      )}
      <div
        class={`lower-panels ${belowHeight === undefined ? "" : "sized"}`}
        role="region"
        aria-label={TEXT.healthAndEvents}
        tabIndex={0}
        hidden={below.length === 0}
        style={belowHeight === undefined ? {} : { height: `${belowHeight}px` }}
      >
        {below.map((panel) => (
          <BelowPanel key={panel.id} session={session} panel={panel} deps={deps} />
        ))}
      </div>
      <ArrangeButton app={app} deps={deps} words />
    </aside>
  );
}

interface PanelProps extends Props {
  readonly session: WorkspaceSession;
  readonly panel: PanelDefinition;
}

/** A panel that takes the available room, or its own; `folds`: the page whose column it folds. */
function SidePanel({ session, panel, deps, folds }: PanelProps & { readonly folds: App | undefined }) {
  const caption = useRef<HTMLSpanElement>(null);
  const layout = deps.viewState.layout.value;
  const height = layout.panels[panel.id]?.height;
  const { after: After } = panel;
  return (
    <section
      class={`side-panel ${height === undefined ? "" : "sized"} ${layout.maximised === panel.id ? "maximised" : ""}`}
      data-panel={panel.id}
      style={height === undefined ? {} : { height: `${height}px` }}
    >
      <PanelHead panel={panel} caption={caption}>
        <span class="grow" />
        {folds && <FoldButton app={folds} />}
      </PanelHead>
      <PanelHost
        class={`panel-host ${panel.class ?? ""}`}
        label={panel.title}
        scrolls
        mount={(host) => panel.mount(host, deps, caption.current)}
      />
      {After && <After deps={deps} />}
      {session.arranging.value && <HeightDivider session={session} panel={panel} height={height} />}
    </section>
  );
}

function HeightDivider({ session, panel, height }: Omit<PanelProps, "deps"> & { readonly height: number | undefined }) {
  return (
    <Divider
      label={WORKSPACE.heightOf(panel.title)}
      orientation="horizontal"
      sign={1}
      target={(handle) => handle.parentElement}
      limits={HEIGHT}
      size={height}
      onSize={(px) => session.adjust((layout) => setHeight(layout, panel.id, px))}
    />
  );
}

function FoldButton({ app: { sheet, folded } }: { readonly app: App }) {
  const fold = (): void => {
    if (sheet.value === "side") sheet.value = undefined;
    else folded.value = true;
  };
  return <IconButton icon="side" label={TEXT.collapsePanel} class="desk" onClick={fold} />;
}

/** As high from the first as it will be: what lies below must not move under a pointer. */
function written(panel: Panel): Panel {
  panel.update(0);
  return panel;
}

/** A panel in the scrolling part. */
function BelowPanel({ session, panel, deps }: PanelProps) {
  const caption = useRef<HTMLSpanElement>(null);
  const layout = deps.viewState.layout.value;
  const height = layout.panels[panel.id]?.height;
  const { after: After } = panel;
  return (
    <section
      class={`health ${height === undefined ? "" : "sized"} ${layout.maximised === panel.id ? "maximised" : ""}`}
      aria-label={panel.title}
      data-panel={panel.id}
      style={height === undefined ? {} : { height: `${height}px` }}
    >
      <PanelHead panel={panel} caption={caption} />
      <PanelHost
        {...(panel.class === undefined ? {} : { class: panel.class })}
        mount={(host) => written(panel.mount(host, deps, caption.current))}
      />
      {After && <After deps={deps} />}
      {session.arranging.value && <HeightDivider session={session} panel={panel} height={height} />}
    </section>
  );
}
