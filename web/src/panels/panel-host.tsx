/** Host of a panel that writes the DOM itself, in the tree of components: mounted once, updated by the frame loop. */
import { type ComponentChild, render } from "preact";
import { useLayoutEffect, useRef } from "preact/hooks";
import { onFrame } from "../data/render-loop";
import type { Deps } from "../page/context";
import { LiveText, type Panel } from "../ui/dom/dom";
import { momentWords, reading } from "./panel-context";
import type { PanelDefinition } from "./registry";

interface Props {
  readonly mount: (host: HTMLElement) => Panel;
  readonly class?: string;
  readonly label?: string;
  readonly role?: "region" | "group";
  /** Id of a panel that can be arranged, if there is nothing around its host. */
  readonly panel?: string;
  readonly style?: Readonly<Record<string, string>>;
  /** Scrolls by itself, so it must be reachable by keyboard. */
  readonly scrolls?: boolean;
}

/** `mount` is called once; a changed function is not noticed (give the component a key instead). */
export function PanelHost(props: Props) {
  const host = useRef<HTMLDivElement>(null);
  // before the first paint: it is never empty on screen, and its content comes a frame sooner
  // biome-ignore lint/correctness/useExhaustiveDependencies: mounted once: another panel has another key
  useLayoutEffect(() => {
    if (!host.current) return undefined;
    const panel = props.mount(host.current);
    const stop = onFrame((now) => panel.update(now));
    return () => {
      stop();
      panel.dispose();
    };
  }, []);
  const named = props.label === undefined ? {} : { role: props.role ?? "region", "aria-label": props.label };
  return (
    <div
      ref={host}
      {...(props.class === undefined ? {} : { class: props.class })}
      {...named}
      {...(props.panel === undefined ? {} : { "data-panel": props.panel })}
      {...(props.style === undefined ? {} : { style: props.style })}
      {...(props.scrolls ? { tabIndex: 0 } : {})}
    />
  );
}

/** Mounts a panel beside its heading, which says the moment that it reads while that is off screen. */
export function mountPanel(panel: PanelDefinition, host: HTMLElement, deps: Deps, caption: HTMLElement | null): Panel {
  const mounted = panel.mount(host, deps, caption);
  if (!panel.readsCursor || !caption) return mounted;
  const words = new LiveText();
  caption.append(words.node);
  return {
    update(now) {
      mounted.update(now);
      const at = reading(deps);
      words.set(at.isOffScreen ? ` ${momentWords(at)}` : "");
    },
    dispose() {
      mounted.dispose();
      words.node.remove();
    },
  };
}

/** A panel of components, which redraw themselves. */
export function renderedPanel(host: HTMLElement, content: ComponentChild): Panel {
  render(content, host);
  return { update: () => undefined, dispose: () => render(null, host) };
}
