/** The middle of the page: attitude, plots, and whatever else was put there, in the order of the layout. */
import { type ComponentChildren, Fragment } from "preact";
import { useRef } from "preact/hooks";
import type { App, Deps } from "../page/context";
import type { PanelDefinition } from "../panels/registry";
import type { Panel } from "../ui/dom/dom";
import { mountPanel, PanelHost } from "../panels/panel-host";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/workspace";
import { Divider } from "./divider";
import { HEIGHT, setHeight } from "../data/layout";
import { PanelHead } from "./panel-head";
import { panelsHere } from "./panels";
import { sessionOf, type WorkspaceSession } from "./session";

interface Props {
  readonly app: App;
  readonly deps: Deps;
  readonly mountPlots: (host: HTMLElement) => Panel;
  /** Bands over the plots. */
  readonly children?: ComponentChildren;
  readonly under?: ComponentChildren;
}

export function MainColumn({ app, deps, mountPlots, children, under }: Props) {
  const session = sessionOf(app, deps.viewState);
  const panels = panelsHere("main", deps);
  const middle = panels.findIndex(({ id }) => id === "plots");
  const { maximised } = deps.viewState.layout.value;
  return (
    <>
      {panels.map((panel, k) =>
        panel.id === "plots" ? (
          <Fragment key={panel.id}>
            {children}
            <div
              class={`plots ${maximised === panel.id ? "maximised" : ""}`}
              id="plots"
              data-panel="plots"
              tabIndex={-1}
            >
              <PanelHost class="plot-host flex-column" label={COMMON.plots} mount={mountPlots} />
            </div>
            {under}
          </Fragment>
        ) : (
          <MainPanel key={panel.id} session={session} deps={deps} panel={panel} isAbove={k < middle} />
        ),
      )}
    </>
  );
}

interface PanelProps {
  readonly session: WorkspaceSession;
  readonly deps: Deps;
  readonly panel: PanelDefinition;
  /** Above the plots, which take the room that is left. */
  readonly isAbove: boolean;
}

function MainPanel({ session, deps, panel, isAbove }: PanelProps) {
  const caption = useRef<HTMLSpanElement>(null);
  const layout = deps.viewState.layout.value;
  const height = layout.panels[panel.id]?.height;
  const isMaximised = layout.maximised === panel.id;
  const style = height === undefined ? {} : { height: `${height}px` };
  const divider = session.arranging.value && (
    <Divider
      key="divider"
      label={TEXT.heightOf(panel.title)}
      orientation="horizontal"
      sign={isAbove ? 1 : -1}
      target={(handle) => (isAbove ? handle.previousElementSibling : handle.nextElementSibling)}
      limits={HEIGHT}
      size={height}
      onSize={(px) => session.adjust((now) => setHeight(now, panel.id, px))}
    />
  );
  const { after: After } = panel;
  return (
    <>
      {!isAbove && divider}
      {panel.id === "attitude" ? (
        // its parts are laid out by the column itself on a phone, so nothing is around it
        <PanelHost
          key="panel"
          class={`attitude ${isMaximised ? "maximised" : ""}`}
          label={panel.title}
          panel={panel.id}
          style={style}
          mount={(host) => panel.mount(host, deps, null)}
        />
      ) : (
        <section
          key="panel"
          class={`main-panel ${panel.height ?? ""} ${isMaximised ? "maximised" : ""}`}
          aria-label={panel.title}
          data-panel={panel.id}
          style={style}
        >
          <PanelHead panel={panel} caption={caption} />
          <div class="panel-body" tabIndex={0} role="group" aria-label={panel.title}>
            <PanelHost
              {...(panel.class === undefined ? {} : { class: panel.class })}
              mount={(host) => mountPanel(panel, host, deps, caption.current)}
            />
            {After && <After deps={deps} />}
          </div>
        </section>
      )}
      {isAbove && divider}
    </>
  );
}
