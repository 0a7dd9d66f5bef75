/** The frame of all pages: the current page, the tabs of a phone, and notices shown on every page. */
import { signal } from "@preact/signals";
import type { ComponentType } from "preact";
import { Icon } from "../ui/icons";
import type { App } from "./app-state";
import { DropVeil } from "./drop";
import { LivePage } from "./live";
import { href, PAGES, route } from "./route";
import { TEXT } from "../texts/live";

/** Heavy parts are loaded on first use; until then they are empty. */
function late<P>(load: () => Promise<{ default: ComponentType<P> }>): {
  readonly value: ComponentType<P> | undefined;
  readonly want: () => void;
} {
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
          asked = false; // the server was away: the next request tries again
        },
      );
    },
  };
}

const configure = late<{ app: App }>(() => import("./configure/page"));
const recordings = late<{ app: App }>(() => import("./recordings/page"));
const decks = late<{ app: App }>(() => import("./configure/rollback-banner"));

export function Shell({ app }: { readonly app: App }) {
  const { page } = route.value;
  const temporary = [...app.store.jobs.value.values()].some((jobs) => jobs.pending_rollback !== null);
  const heavy = page === "live" ? undefined : page === "configure" ? configure : recordings;
  heavy?.want();
  if (temporary) decks.want();
  const Heavy = heavy?.value;
  const Decks = decks.value;
  return (
    <>
      {heavy ? Heavy ? <Heavy app={app} /> : <div class="app" aria-busy="true" /> : <LivePage app={app} />}
      {temporary && Decks && <Decks app={app} />}
      <Tabs />
      <DropVeil app={app} />
    </>
  );
}

/** Navigation; the device stays the same. */
function Tabs() {
  return (
    <nav class="tabs" aria-label={TEXT.pages}>
      {PAGES.map(({ name, title, icon }) => (
        <a key={name} href={href(name)} {...(route.value.page === name ? { "aria-current": "page" as const } : {})}>
          <Icon name={icon} />
          {title}
        </a>
      ))}
    </nav>
  );
}
