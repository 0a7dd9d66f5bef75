import { expect, it } from "vitest";
import { BLANK, flowOf, ntripProblem, ntripUrl } from "./form";

it("gives a valid source for any password", () => {
  expect(
    ntripUrl({ ...BLANK, host: "caster.example", port: "2101", mount: "NEAR", user: "me", password: "p@ss/w:rd" }),
  ).toBe("ntrip://me:p%40ss%2Fw%3Ard@caster.example:2101/NEAR");
  expect(ntripUrl({ ...BLANK, host: "caster", mount: "/M 1", tls: true })).toBe("ntrips://caster/%2FM%201");
});

it("reports missing parts", () => {
  expect(ntripProblem(BLANK)).toContain("host");
  expect(ntripProblem({ ...BLANK, host: "ntrip://x" })).toContain("name or IP address");
  expect(ntripProblem({ ...BLANK, host: "x", port: "99999", mount: "M" })).toContain("port");
  expect(ntripProblem({ ...BLANK, host: "x", mount: "M" })).toBe("");
});

it("does not report a refused stream as running", () => {
  expect(flowOf({ running: true, forwarding: false, age_s: null }).word).not.toContain("Running");
  expect(flowOf({ running: true, forwarding: false, age_s: null }).dot).toBe("bad");
  expect(flowOf({ running: true, forwarding: true, age_s: 1 }).word).toBe("Forwarding");
});
