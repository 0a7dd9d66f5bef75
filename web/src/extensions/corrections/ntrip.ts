/** A source of corrections as fields, and as the single text that the server accepts. Pure. */
import { TEXT } from "./texts";

export interface Ntrip {
  readonly host: string;
  readonly port: string;
  readonly mount: string;
  readonly user: string;
  readonly password: string;
  readonly tls: boolean;
}

export const BLANK: Ntrip = { host: "", port: "", mount: "", user: "", password: "", tls: false };

/** ntrip://user:password@host:2101/MOUNT; every part quoted, so that a password may contain anything. */
export function ntripUrl({ host, port, mount, user, password, tls }: Ntrip): string {
  const who = user || password ? `${encodeURIComponent(user)}:${encodeURIComponent(password)}@` : "";
  const name = host.trim();
  const address = name.includes(":") && !name.startsWith("[") ? `[${name}]` : name;
  return `${tls ? "ntrips" : "ntrip"}://${who}${address}${port.trim() ? `:${port.trim()}` : ""}/${encodeURIComponent(mount.trim())}`;
}

/** The missing or invalid part, in a sentence; "" for none. */
export function ntripProblem({ host, port, mount }: Ntrip): string {
  if (host.trim() === "") return TEXT.hostMissing;
  if (/[\s/@]/.test(host.trim())) return TEXT.hostInvalid;
  if (port.trim() !== "" && !(/^\d{1,5}$/.test(port.trim()) && Number(port) >= 1 && Number(port) <= 65_535))
    return TEXT.portInvalid;
  return mount.trim() === "" ? TEXT.mountPointMissing : "";
}

/** State of a stream in a word; one that is only being tried is not running. */
export function flowOf({
  running,
  forwarding,
  age_s,
}: {
  readonly running: boolean;
  readonly forwarding: boolean;
  readonly age_s: number | null;
}): { readonly word: string; readonly dot: string } {
  if (!running) return { word: TEXT.stopped, dot: "off" };
  if (!forwarding) return { word: TEXT.retrying, dot: "bad" };
  return (age_s ?? 0) > OLD_S ? { word: TEXT.forwardingIdle, dot: "warn" } : { word: TEXT.forwarding, dot: "live" };
}

const OLD_S = 10;
