import { expect, it } from "vitest";
import { field, setting } from "../../testing/fixtures";
import { optionsOf } from "./setting-form";

const form = setting({
  name: "FilterProfile",
  fields: [
    field({
      name: "profile",
      editor: "text",
      options: ["Responsive/VRU", "Responsive/NorthReference", "Robust/VRU"],
      listed: { setting: "AvailableFilterProfiles", records: "profiles", text: "label", used: "type" },
    }),
  ],
});

it("offers the profiles that the device lists", () => {
  const profiles = ["Responsive ", "VRU", "Mine"].map((label, k) => ({ type: k + 1, version: 1, label }));
  const present = { AvailableFilterProfiles: { profiles: [...profiles, { type: 0, version: 0, label: "Robust" }] } };
  expect(optionsOf(form, present)).toEqual({ profile: ["Responsive/VRU", "Mine"] });
});

it("offers the product's known values before the device was read, and nothing for free text", () => {
  expect(optionsOf(form, {}).profile).toHaveLength(3);
  expect(optionsOf(setting({ fields: [field({ name: "label", editor: "text" })] }), {})).toEqual({});
});
