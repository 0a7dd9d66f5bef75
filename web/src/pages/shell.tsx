/** The page around the pages: which one is shown, the tabs of a phone, and what must be seen on every one. */
import { signal } from "@preact/signals";
import type { ComponentType } from "preact";
import type { Store } from "../data/store";
import { Icon } from "../ui/icons";
import type { App } from "./app-state";
import { DropVeil } from "./drop";
import { LivePage } from "./live";
import { href, PAGES, route } from "./route";

/** Heavy parts come when they are first wanted; until then there is nothing of them. */
function late<P>(load: () => Promise<{ default: ComponentType<P> }>): { readonly value: ComponentType<P> | undefined; readonly want: () => void } {
  const found = signal<ComponentType<P> | undefined>(undefined);
  let asked = false;
  return {
    get value() {
      return found.value;
    },
    want() {
      if (asked) return;
      asked = true;
      load().then(
        (module) => {
          found.value = module.default;
        },
        () => {
          asked = false; // the server was away: the next wish tries again
        },
      );
    },
  };
}

const configure = late<{ app: App }>(() => import("./configure/page"));
const recordings = late<{ app: App }>(() => import("./recordings/page"));
const decks = late<{ store: Store }>(() => import("./configure/rollback-banner"));

export function Shell({ app }: { readonly app: App }) {
  const { page } = route.value;
  const onTrial = [...app.store.control.value.values()].some(({ trial }) => trial !== null);
  const heavy = page === "live" ? undefined : page === "configure" ? configure : recordings;
  heavy?.want();
  if (onTrial) decks.want();
  const Heavy = heavy?.value;
  const Decks = decks.value;
  return (
    <>
      {heavy ? Heavy ? <Heavy app={app} /> : <div class="app" aria-busy="true" /> : <LivePage app={app} />}
      {onTrial && Decks && <Decks store={app.store} />}
      <Tabs />
      <DropVeil />
    </>
  );
}

/** Where one goes from here; the device stays the same. */
function Tabs() {
  return (
    <nav class="tabs" aria-label="Pages">
      {PAGES.map(({ name, title, icon }) => (
        <a key={name} href={href(name)} {...(route.value.page === name ? { "aria-current": "page" as const } : {})}>
          <Icon name={icon} />
          {title}
        </a>
      ))}
    </nav>
  );
}
