/** Of Node, which tests run in and the page does not, no more than they use. */
declare module "node:fs" {
  export function readFileSync(path: string): Uint8Array;
}
declare module "node:path" {
  export function join(...parts: string[]): string;
}
declare module "node:zlib" {
  export function gunzipSync(data: Uint8Array): { toString(): string };
}
