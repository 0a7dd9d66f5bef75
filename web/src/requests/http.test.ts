import { expect, test, vi } from "vitest";
import { addressOf, request, respond } from "./http";

/** Answers every request in this way; returns the requests. */
function answering(answer: () => Response): readonly [path: string, init: RequestInit][] {
  const asked: [string, RequestInit][] = [];
  vi.stubGlobal("fetch", (path: string, init: RequestInit) => {
    asked.push([path, init]);
    return Promise.resolve(answer());
  });
  return asked;
}

const json = (value: unknown, status = 200): Response => Response.json(value, { status });

test("names in a path are escaped, and a query contains the given values", () => {
  expect(addressOf("GET /api/recordings/{recording}/download", { path: { recording: "a/b c" } })).toBe(
    "/api/recordings/a%2Fb%20c/download",
  );
  expect(
    addressOf("GET /api/devices/{device}/traffic", {
      path: { device: "1" },
      query: { before: undefined, limit: 200 },
    }),
  ).toBe("/api/devices/1/traffic?limit=200");
  expect(addressOf("GET /api/recordings")).toBe("/api/recordings");
});

test("changing requests are sent as JSON, also without content", async () => {
  const asked = answering(() => json({ id: "1" }));
  await request("POST /api/devices/{device}/retry", { path: { device: "1" } });
  await request("POST /api/devices", { body: { source: "udp://:1" } });
  await request("DELETE /api/devices/{device}", { path: { device: "1" } });
  const type = { "content-type": "application/json" };
  expect(asked.map(([path, { method, headers, body }]) => [method, path, headers, body])).toEqual([
    ["POST", "/api/devices/1/retry", type, "{}"],
    ["POST", "/api/devices", type, '{"source":"udp://:1"}'],
    ["DELETE", "/api/devices/1", type, undefined],
  ]);
});

test("JSON is parsed, text stays text even if it is valid JSON, and no content is undefined", async () => {
  const answers = [json([]), new Response("12", { headers: { "content-type": "application/yaml" } })];
  answering(() => answers.shift() ?? new Response(null, { status: 204 }));
  expect(await request("GET /api/devices")).toEqual({ ok: true, value: [] });
  const path = { device: "1", name: "x" };
  expect(await request("GET /api/devices/{device}/snapshots/{name}", { path })).toEqual({ ok: true, value: "12" });
  expect(await request("DELETE /api/devices/{device}", { path })).toEqual({ ok: true, value: undefined });
});

test("every failure is a problem with a message", async () => {
  answering(() => json({ kind: "busy", message: "The recording is still running.", hint: "Stop it." }, 409));
  const busy = { kind: "busy", message: "The recording is still running.", hint: "Stop it.", status: 409 };
  expect(await request("GET /api/devices")).toEqual({ ok: false, problem: busy });
  answering(() => new Response("<html>", { status: 502 }));
  expect(await respond("GET /api/devices")).toMatchObject({ kind: "http-502", status: 502 });
  vi.stubGlobal("fetch", () => Promise.reject(new TypeError()));
  expect(await request("GET /api/devices")).toMatchObject({ ok: false, problem: { kind: "offline", status: 0 } });
});
