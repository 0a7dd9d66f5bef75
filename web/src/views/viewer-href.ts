/** Where does Rerun's viewer show this? Pure. */

/** The address of a recording in the viewer, or of a stretch of it (unix s). */
export function viewerHref(recording: string, range: readonly [number, number] | undefined, theme: "dark" | "light"): string {
  const query = new URLSearchParams({ recording });
  if (range) {
    query.set("t0", String(range[0]));
    query.set("t1", String(range[1]));
  }
  query.set("theme", theme);
  return `/rerun/?${query}`;
}

/** The address of what devices send now in the viewer: of one device, or of all without one. */
export function liveHref(device: string | undefined, theme: "dark" | "light"): string {
  return `/rerun/?${new URLSearchParams({ live: device ?? "", theme })}`;
}
