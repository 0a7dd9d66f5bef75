/** A source of corrections as fields, and as the one text that the server takes. Pure. */
export interface Ntrip {
  readonly host: string;
  readonly port: string;
  readonly mount: string;
  readonly user: string;
  readonly password: string;
  readonly tls: boolean;
}

export const BLANK: Ntrip = { host: "", port: "", mount: "", user: "", password: "", tls: false };

/** ntrip://user:password@host:2101/MOUNT; every part quoted, so that a password may hold anything. */
export function sourceOf({ host, port, mount, user, password, tls }: Ntrip): string {
  const who = user || password ? `${encodeURIComponent(user)}:${encodeURIComponent(password)}@` : "";
  const name = host.trim();
  const address = name.includes(":") && !name.startsWith("[") ? `[${name}]` : name;
  return `${tls ? "ntrips" : "ntrip"}://${who}${address}${port.trim() ? `:${port.trim()}` : ""}/${encodeURIComponent(mount.trim())}`;
}

/** What is missing or wrong, in a sentence; "" for nothing. */
export function ntripProblem({ host, port, mount }: Ntrip): string {
  if (host.trim() === "") return "The caster's host is missing.";
  if (/[\s/@]/.test(host.trim())) return "The host is a name or an address only: no ntrip://, no slash.";
  if (port.trim() !== "" && !(/^\d{1,5}$/.test(port.trim()) && Number(port) >= 1 && Number(port) <= 65_535)) return "A port is a number from 1 to 65 535.";
  return mount.trim() === "" ? "The mount point is missing." : "";
}

/** How a stream goes, in a word: what is only tried does not run. */
export function flowOf({ running, forwarding, age_s }: { readonly running: boolean; readonly forwarding: boolean; readonly age_s: number | null }): { readonly word: string; readonly dot: string } {
  if (!running) return { word: "Stopped", dot: "off" };
  if (!forwarding) return { word: "Not forwarding, trying again", dot: "bad" };
  return (age_s ?? 0) > OLD_S ? { word: "Forwarding, but nothing new", dot: "warn" } : { word: "Forwarding", dot: "live" };
}

const OLD_S = 10;
