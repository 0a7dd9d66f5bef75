/**
 * The address of Live contains the view: a reload restores it, and a link shows it to others.
 *
 *     #/?device=2&span=5&base=arrival&frame=NED&hide=…&show=…&panels=…     while it follows the newest sample
 *     #/?device=2&t0=…&t1=…&cursor=…&measure=…                             while paused: as long as the server has the data
 */
import type { ViewState } from "../data/view-state";
import { type LinkedPlace, placeQuery, readPlace, seriesOf, takeSeries } from "../page/permalink";
import { copyText } from "../ui/dom/copy";
import { applyLinkText, linkTextOf } from "../workspace/parts";
import { sessionOf } from "../workspace/session";
import type { App } from "../page/context";
import { keepAddress } from "./keep-address";
import { linkName } from "../wire/device-name";
import { href, route } from "../page/route";

/** Content of a link to the view. */
export function livePlace(of: ViewState): LinkedPlace {
  const { view, cursor, measure, frame, hiddenSeries, knownNorms, extraPlots, customPlots } = of;
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
    ...seriesOf(hiddenSeries.peek(), knownNorms),
    panels: [...extraPlots.peek()],
    ...(customPlots.peek().length > 0 ? { plots: customPlots.peek() } : {}),
  };
}

/** Show a place; what it lacks stays at Live's default. */
export function goLive(app: App, place: LinkedPlace): void {
  const { view, cursor, measure, frame, hiddenSeries, knownNorms, extraPlots, customPlots } = app.viewState;
  const { t0, t1 } = place;
  const still = t0 !== undefined && t1 !== undefined;
  const span = still ? t1 - t0 : place.span;
  view.value = {
    ...view.peek(),
    live: !still,
    ...(still ? { end: t1 } : {}),
    ...(span === undefined ? {} : { span }),
    timeBase: place.base ?? "device",
  };
  cursor.value = place.cursor === undefined ? undefined : { kind: "pinned", time: place.cursor };
  measure.value = place.measure;
  frame.value = place.frame;
  hiddenSeries.value = takeSeries(place, knownNorms);
  extraPlots.value = new Set(place.panels);
  customPlots.value = place.plots ?? [];
  const session = sessionOf(app, app.viewState);
  session.problems.value = applyLinkText(session.view, place.workspace);
  if (place.device !== undefined) app.linked.value = place.device;
}

function liveHref(app: App): string {
  const workspace = linkTextOf(sessionOf(app, app.viewState).view);
  const place = livePlace(app.viewState);
  const named = place.device === undefined ? {} : { device: linkName(place.device, app.store.devices.peek()) };
  const query = placeQuery({ ...place, ...named, ...(workspace === undefined ? {} : { workspace }) });
  return href("live") + (query ? `?${query}` : "");
}

/** Follow the address, and keep it up to date with the view. */
export function startLiveAddress(app: App): void {
  const { viewState } = app;
  let ours = "";
  const take = (query: string | undefined): void => {
    if (query) goLive(app, readPlace(query));
  };
  if (route.peek().page === "live") take(route.peek().query);
  route.subscribe(({ page, query }) => {
    if (page === "live" && location.hash !== ours) take(query);
  });
  const next = (): string | undefined => {
    const isThere = location.hash === "" || location.hash === "#/" || location.hash.startsWith("#/?");
    const isShown = route.peek().page === "live" && isThere && viewState.view.peek().device !== undefined;
    return isShown ? liveHref(app) : undefined;
  };
  keepAddress(next, (hash) => {
    ours = hash;
  });
}

/** Copy the link to the view; false if the browser refuses: the address above is the link. */
export async function copyLiveLink(app: App): Promise<boolean> {
  const link = liveHref(app);
  history.replaceState(null, "", link);
  return copyText(new URL(link, location.href).href);
}
