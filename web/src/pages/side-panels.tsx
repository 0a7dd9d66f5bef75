/** The registered panels beside the plots (panels/registry.ts), of Live and of an open recording. */
import { useRef } from "preact/hooks";
import "../panels/all";
import { type PanelDefinition, panelsAt } from "../panels/registry";
import { Icon } from "../ui/icons";
import { PanelHost } from "../ui/panel-host";
import type { Deps } from "../panels/panel-context";
import type { App } from "./app-state";
import { TEXT } from "../texts/live";

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

export function Side({ app, deps }: Props & { readonly app: App }) {
  return (
    <aside class={`side ${app.sheet.value === "side" ? "open" : ""}`} id="side" aria-label={TEXT.valuesAndHealth}>
      {panelsAt("side", deps).map((panel, k) => (
        <SidePanel key={panel.id} panel={panel} deps={deps} folds={k === 0 ? app : undefined} />
      ))}
      <div class="lower-panels" role="region" aria-label={TEXT.healthAndEvents} tabIndex={0}>
        {panelsAt("below", deps).map((panel) => (
          <BelowPanel key={panel.id} panel={panel} deps={deps} />
        ))}
      </div>
    </aside>
  );
}

interface PanelProps extends Props {
  readonly panel: PanelDefinition;
}

/** A panel that takes the available room; `folds`: the page whose column it folds. */
function SidePanel({ panel, deps, folds }: PanelProps & { readonly folds: App | undefined }) {
  const caption = useRef<HTMLSpanElement>(null);
  return (
    <>
      <div class="head">
        <h2>{panel.title}</h2>
        <span ref={caption}>{panel.note}</span>
        <span class="grow" />
        {folds && <FoldButton app={folds} />}
      </div>
      <PanelHost
        class={panel.class ?? ""}
        label={panel.title}
        scrolls
        mount={(host) => panel.mount(host, deps, caption.current)}
      />
    </>
  );
}

function FoldButton({ app: { sheet, folded } }: { readonly app: App }) {
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
function BelowPanel({ panel, deps }: PanelProps) {
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
        mount={(host) => panel.mount(host, deps, caption.current)}
      />
      {After && <After deps={deps} />}
    </section>
  );
}
