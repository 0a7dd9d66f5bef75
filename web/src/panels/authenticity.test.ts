import { describe, expect, it } from "vitest";
import type { DeviceHealth } from "../wire/types";
import { keyWanted, keyWrong, rejections, trustOf } from "./authenticity";

const health = (more: Partial<DeviceHealth>): DeviceHealth =>
  ({ rejects_by: {}, verified: null, unverified: null, ...more }) as DeviceHealth;

describe("trustOf", () => {
  it("shows verified, unverified or not protected, not by colour alone", () => {
    const told = [
      ["Secure, verified", 5, 0],
      ["Secure, unverified: no key", 0, 7],
      ["Safety, CRC-32", 5, 0],
      ["Lite, CRC-8 of the header alone", 5, 0],
    ] as const;
    const said = told.map(([protection, verified, unverified]) =>
      trustOf({ protection }, health({ verified, unverified })),
    );
    expect(said.map((trust) => `${trust?.mark} ${trust?.word} · ${trust?.detail}`)).toEqual([
      "● verified · Secure",
      "▲ unverified · Secure: no key",
      "● verified · Safety, CRC-32",
      "○ not protected · Lite, CRC-8 of the header alone",
    ]);
  });
  it("shows nothing for a protocol without protection", () => {
    expect(trustOf({ protection: "" }, health({}))).toBeUndefined();
    expect(trustOf({ protection: "" }, undefined)).toBeUndefined();
  });
});

describe("rejected frames", () => {
  it("are counted by reason, in words", () => {
    const report = health({ rejects_by: { bad_checksum: 2, no_key: 1204, truncated: 0 } });
    expect(rejections(report).map(({ words, count }) => `${words} ${count}`)).toEqual([
      "no key 1204",
      "bad checksum 2",
    ]);
    expect(keyWanted(report)).toBe("1\u2009204 Secure frames rejected: no key to verify them.");
    expect(keyWanted(health({ rejects_by: { stale: 3 } }))).toBe("");
  });
  it("distinguish a wrong key from damaged frames", () => {
    expect(keyWrong(health({ rejects_by: { bad_hmac: 1 }, verified: 0 }))).toBe(
      "1 Secure frame rejected: the key does not match.",
    );
    expect(keyWrong(health({ rejects_by: { bad_hmac: 1 }, verified: 900 }))).toBe("");
  });
});
