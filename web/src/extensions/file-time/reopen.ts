/** A recording whose times changed as a whole is opened again, from its beginning. */
import { href, parse, reopened, route } from "../../page/route";

/** What an address says in times of the recording. */
const TIMES = ["t0", "t1", "span", "cursor", "measure", "loop"];

/** The address of a recording, with all that the present one says but times. */
export function addressWithoutTimes(recording: string, hash: string): string {
  const place = href("recordings", recording);
  const [before = "", query = ""] = hash.split("?");
  if (before !== place) return place;
  const kept = new URLSearchParams(query);
  for (const name of TIMES) kept.delete(name);
  return kept.size === 0 ? place : `${place}?${kept}`;
}

export function reopen(recording: string): void {
  const hash = addressWithoutTimes(recording, location.hash);
  const isThere = route.peek().recording === recording;
  if (isThere) history.replaceState(null, "", hash);
  else location.hash = hash;
  route.value = parse(hash) ?? route.peek();
  reopened.value += 1;
}
