/** The registered panels beside the plots (panels/registry.ts), of Live and of an open recording. */
import { useRef } from "preact/hooks";
import "../panels/all";
import { type PanelDefinition, panelsAt } from "../panels/registry";
import { Icon } from "../ui/icons";
import { showsPlots } from "../ui/page-state";
import { PanelHost } from "../ui/panel-host";
import { type App, folded, sheet } from "./app-state";
import { TEXT } from "../texts/live";

interface Props {
  readonly app: App;
}

/** The panels over the plots if the side column has no room. */
export function Strip({ app }: Props) {
  return (
    <>
      {panelsAt("strip", app).map((panel) => (
        <PanelHost
          key={panel.id}
          class={panel.class ?? ""}
          label={panel.title}
          scrolls
          mount={(host) => panel.mount(host, app, null)}
        />
      ))}
    </>
  );
}

export function Side({ app }: Props) {
  if (!showsPlots(app.state.value)) return null;
  return (
    <aside class={`side ${sheet.value === "side" ? "open" : ""}`} id="side" aria-label={TEXT.valuesAndHealth}>
      {panelsAt("side", app).map((panel, k) => (
        <SidePanel key={panel.id} panel={panel} app={app} folds={k === 0} />
      ))}
      <div class="lower-panels" role="region" aria-label={TEXT.healthAndEvents} tabIndex={0}>
        {panelsAt("below", app).map((panel) => (
          <BelowPanel key={panel.id} panel={panel} app={app} />
        ))}
      </div>
    </aside>
  );
}

interface PanelProps extends Props {
  readonly panel: PanelDefinition;
}

/** A panel that takes the available room. */
function SidePanel({ panel, app, folds }: PanelProps & { readonly folds: boolean }) {
  const caption = useRef<HTMLSpanElement>(null);
  return (
    <>
      <div class="head">
        <h2>{panel.title}</h2>
        <span ref={caption}>{panel.note}</span>
        <span class="grow" />
        {folds && <FoldButton />}
      </div>
      <PanelHost
        class={panel.class ?? ""}
        label={panel.title}
        scrolls
        mount={(host) => panel.mount(host, app, caption.current)}
      />
    </>
  );
}

function FoldButton() {
  const fold = (): void => {
    if (sheet.value === "side") sheet.value = undefined;
    else folded.value = true;
  };
  return (
    <button
      type="button"
      class="btn icon desk"
      aria-label={TEXT.collapsePanel}
      title={TEXT.collapsePanel}
      onClick={fold}
    >
      <Icon name="side" />
    </button>
  );
}

/** A panel in the scrolling part. */
function BelowPanel({ panel, app }: PanelProps) {
  const caption = useRef<HTMLSpanElement>(null);
  const { after: After } = panel;
  return (
    <section class="health" aria-label={panel.title}>
      <div class="head">
        <h2>{panel.title}</h2>
        <span ref={caption}>{panel.note}</span>
      </div>
      <PanelHost
        {...(panel.class === undefined ? {} : { class: panel.class })}
        mount={(host) => panel.mount(host, app, caption.current)}
      />
      {After && <After deps={app} />}
    </section>
  );
}
