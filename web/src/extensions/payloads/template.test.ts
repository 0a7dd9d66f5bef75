import { describe, expect, it } from "vitest";
import { initialDefinition } from "./dialog";

const family = {
  payload_template: "# {size} bytes, {other}\ntype 0x{id}\n{type}\ncount {count}\nend\n",
  payload_numbers: [
    { name: "i16", size: 2 },
    { name: "u8", size: 1 },
  ],
};

describe("an initial definition", () => {
  it("covers every byte of the payload", () => {
    expect(initialDefinition(family, { id: 0x80, size: 6 })).toBe("# 6 bytes, {other}\ntype 0x80\ni16\ncount 3\nend\n");
    expect(initialDefinition(family, { id: 0x9, size: 5 })).toBe("# 5 bytes, {other}\ntype 0x09\nu8\ncount 5\nend\n");
  });

  it("has no count for a single number", () => {
    expect(initialDefinition(family, { id: 0x80, size: 2 })).toBe("# 2 bytes, {other}\ntype 0x80\ni16\nend\n");
  });
});
