/** The frame of all pages: the current page, the tabs of a phone, and notices shown on every page. */
import "../extensions/all";
import type { FunctionComponent } from "preact";
import { fromExtensions } from "../extension/extension";
import { Icon } from "../ui/controls/icons";
import { late } from "../ui/dom/late";
import type { App } from "../page/context";
import { DropVeil } from "../pages/drop";
import { LivePage } from "../pages/live";
import { href, type PageName, pagesOf, route } from "../page/route";
import { TEXT } from "../texts/live";

const loading = <div class="app" aria-busy="true" />;
const ConfigurePage = late(async () => (await import("../pages/configure/page")).ConfigurePage, loading);
const RecordingsPage = late(async () => (await import("../pages/recordings/page")).RecordingsPage, loading);
const Decks = late(async () => (await import("../pages/configure/rollback-banner")).Decks);

export function Shell({ app }: { readonly app: App }) {
  const { page } = route.value;
  const temporary = [...app.store.jobs.value.values()].some((jobs) => jobs.pending_rollback !== null);
  const special = fromExtensions("addresses").find(({ takes }) => takes(route.value));
  const Page = special?.View ?? fromExtensions("pages").find(({ name }) => name === page)?.View ?? viewOf(page);
  return (
    <>
      <Page app={app} />
      {temporary && <Decks app={app} />}
      <Tabs app={app} />
      <DropVeil app={app} />
    </>
  );
}

function viewOf(page: PageName): FunctionComponent<{ readonly app: App }> {
  if (page === "configure") return ConfigurePage;
  return page === "recordings" ? RecordingsPage : LivePage;
}

/** Navigation; the device stays the same. */
function Tabs({ app }: { readonly app: App }) {
  return (
    <nav class="tabs" aria-label={TEXT.pages}>
      {pagesOf(app).map(({ name, title, icon }) => (
        <a key={name} href={href(name)} {...(route.value.page === name ? { "aria-current": "page" as const } : {})}>
          <Icon name={icon} />
          {title}
        </a>
      ))}
    </nav>
  );
}
