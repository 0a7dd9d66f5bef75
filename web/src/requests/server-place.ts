/**
 * Where the server of this page is: in the folder of the page's own address. A proxy may have put it below a path, "/imu/"; a fleet server has
 * the pages of its robots below /robots/NAME/, and says so in the document.
 */
const here = (): string => (typeof location === "undefined" ? "/" : location.pathname);

/** What precedes the path of every request: empty at the root of a host, else "/imu" or "/robots/otter-7". */
export function serverRoot(pathname: string = here()): string {
  return pathname.slice(0, Math.max(0, pathname.lastIndexOf("/")));
}

/** Name of the robot whose page the fleet server shows; undefined at the robot's own address. */
export function shownRobot(): string | undefined {
  return typeof document === "undefined" ? undefined : document.documentElement.dataset["robot"];
}

/** The same as `serverRoot` of this page, and of the fleet server where the page is that of one of its robots. */
export function fleetRoot(): string {
  return shownRobot() === undefined ? serverRoot() : serverRoot().split("/").slice(0, -2).join("/");
}

/** Address of a page of a robot at its fleet server. */
export function robotHref(name: string, page = ""): string {
  return `${fleetRoot()}/robots/${encodeURIComponent(name)}/#/${page}`;
}

/** Address of a WebSocket of the server, with the page's own kind of security. */
export function socketUrl(path: string): string {
  return `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}${serverRoot()}${path}`;
}
