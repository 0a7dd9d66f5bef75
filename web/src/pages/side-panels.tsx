/** The registered panels beside the plots (panels/registry.ts), of Live and of an open recording. */
import { useRef } from "preact/hooks";
import "../attitude/panel";
import "../panels/all";
import { type PanelDefinition, panelsAt } from "../panels/registry";
import { IconButton } from "../ui/controls/icon-button";
import type { Panel } from "../ui/dom/dom";
import { mountPanel, PanelHost } from "../panels/panel-host";
import type { Deps, App } from "../page/context";
import { ArrangeButton } from "../workspace/arrange";
import { Divider } from "../workspace/divider";
import { HEIGHT, setHeight, setSize, SIDE_WIDTH } from "../data/layout";
import { PanelHead } from "../workspace/panel-head";
import { panelsHere, panelsOf } from "../workspace/panels";
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
        <ColumnPanel key={panel.id} session={session} panel={panel} deps={deps} folds={k === 0 ? app : undefined} />
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
          <ColumnPanel key={panel.id} session={session} panel={panel} deps={deps} below />
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

interface ColumnPanelProps extends PanelProps {
  /** Of the scrolling part; the others take the available room, or their own. */
  readonly below?: boolean;
  /** The page whose column it folds. */
  readonly folds?: App | undefined;
}

function ColumnPanel({ session, panel, deps, below = false, folds }: ColumnPanelProps) {
  const caption = useRef<HTMLSpanElement>(null);
  const layout = deps.viewState.layout.value;
  const height = layout.panels[panel.id]?.height;
  const { after: After, class: own = "" } = panel;
  return (
    <section
      class={`${below ? "health" : "side-panel"} ${height === undefined ? "" : "sized"} ${layout.maximised === panel.id ? "maximised" : ""}`}
      {...(below ? { "aria-label": panel.title } : {})}
      data-panel={panel.id}
      style={height === undefined ? {} : { height: `${height}px` }}
    >
      <PanelHead panel={panel} session={session} all={panelsOf(deps)} caption={caption}>
        {!below && <span class="grow" />}
        {folds && <FoldButton app={folds} />}
      </PanelHead>
      <PanelHost
        {...(below ? { class: own } : { class: `panel-host ${own}`, label: panel.title, scrolls: true })}
        mount={(host) => written(mountPanel(panel, host, deps, caption.current))}
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
  try {
    panel.update(0);
  } catch (error) {
    reportError(error); // one broken panel must not stop the others
  }
  return panel;
}
