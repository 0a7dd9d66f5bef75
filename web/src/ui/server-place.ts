/** Where the server of this page is: at this host, or a robot behind its fleet server, below /robots/NAME/. */
const ON_ROBOT = /^\/robots\/([^/]+)\//;

const here = (): string => (typeof location === "undefined" ? "/" : location.pathname);

/** What precedes the path of every request: empty, or "/robots/otter-7". */
export function serverRoot(pathname: string = here()): string {
  return ON_ROBOT.exec(pathname)?.[0].slice(0, -1) ?? "";
}

/** Name of the robot whose page the fleet server shows; undefined at the robot's own address. */
export function shownRobot(pathname: string = here()): string | undefined {
  const name = ON_ROBOT.exec(pathname)?.[1];
  try {
    return name === undefined ? undefined : decodeURIComponent(name);
  } catch {
    return name; // a stray "%" in a typed address
  }
}

/** Address of a page of a robot at its fleet server. */
export function robotHref(name: string, page = ""): string {
  return `/robots/${encodeURIComponent(name)}/#/${page}`;
}
