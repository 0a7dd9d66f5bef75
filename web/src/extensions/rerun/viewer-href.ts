/** Addresses of recordings and devices in Rerun's viewer. */
import { serverRoot } from "../../requests/server-place";

/** The address of a recording, or of a range of it (unix s), in the viewer. */
export function viewerHref(
  recording: string,
  range: readonly [number, number] | undefined,
  theme: "dark" | "light",
): string {
  const query = new URLSearchParams({ recording });
  if (range) {
    query.set("t0", String(range[0]));
    query.set("t1", String(range[1]));
  }
  query.set("theme", theme);
  return `${serverRoot()}/rerun/?${query}`;
}

/** The address of live data in the viewer: of one device, or of all. */
export function liveHref(device: string | undefined, theme: "dark" | "light"): string {
  return `${serverRoot()}/rerun/?${new URLSearchParams({ live: device ?? "", theme })}`;
}
