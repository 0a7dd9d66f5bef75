/**
 * The address of Live carries what is looked at: a reload finds it again, and a link shows it to somebody else.
 *
 *     #/?device=2&span=5&base=arrival&frame=NED&hide=…&show=…&panels=…     while it follows the newest sample
 *     #/?device=2&t0=…&t1=…&cursor=…&measure=…                             while it stands still: as long as the server remembers it
 */
import { cursor, frame, hidden, measure, normsSeen, view } from "../data/view-state";
import { asked } from "../plots/plot-stack";
import { type Place, placeQuery, readPlace, seriesOf, takeSeries } from "../recordings/permalink";
import { copyText } from "../ui/copy";
import { select } from "./app-state";
import { href, route } from "./route";

/** The address follows what is on screen this often, ms. */
const ADDRESS_MS = 1000;

/** What a link to what is on screen carries. */
export function livePlace(): Place {
  const { live, end, span, device, timeBase } = view.peek();
  const at = cursor.peek();
  const second = measure.peek();
  return {
    ...(live ? { span } : { t0: end - span, t1: end }),
    ...(at?.kind === "pinned" ? { cursor: at.time } : {}),
    ...(second === undefined ? {} : { measure: second }),
    ...(device === undefined ? {} : { device }),
    ...(frame.peek() === undefined ? {} : { frame: frame.peek()! }),
    base: timeBase,
    ...seriesOf(hidden.peek(), normsSeen),
    panels: [...asked.peek()],
  };
}

/** Look at a place; what it does not say stays as it is where Live begins. */
export function goLive(place: Place): void {
  const { t0, t1 } = place;
  const still = t0 !== undefined && t1 !== undefined;
  const span = still ? t1 - t0 : place.span;
  view.value = { ...view.peek(), live: !still, ...(still ? { end: t1 } : {}), ...(span === undefined ? {} : { span }), timeBase: place.base ?? "device" };
  cursor.value = place.cursor === undefined ? undefined : { kind: "pinned", time: place.cursor };
  measure.value = place.measure;
  frame.value = place.frame;
  hidden.value = takeSeries(place, normsSeen);
  asked.value = new Set(place.panels);
  if (place.device !== undefined) select(place.device);
}

export function liveHref(): string {
  const query = placeQuery(livePlace());
  return href("live") + (query ? `?${query}` : "");
}

/** Follow the address from here on, and have it follow what is on screen. */
export function startLiveAddress(): void {
  let ours = "";
  const take = (query: string | undefined): void => {
    if (query) goLive(readPlace(query));
  };
  if (route.peek().page === "live") take(route.peek().query);
  route.subscribe(({ page, query }) => {
    if (page === "live" && location.hash !== ours) take(query);
  });
  setInterval(() => {
    const isThere = location.hash === "" || location.hash === "#/" || location.hash.startsWith("#/?");
    if (route.peek().page !== "live" || !isThere || view.peek().device === undefined) return;
    const next = liveHref();
    if (next === location.hash) return;
    ours = next;
    history.replaceState(null, "", next);
  }, ADDRESS_MS);
}

/** Copy the link to what is on screen; false where the browser does not let the page: the address above is the link. */
export async function copyLiveLink(): Promise<boolean> {
  const link = liveHref();
  history.replaceState(null, "", link);
  return copyText(new URL(link, location.href).href);
}
