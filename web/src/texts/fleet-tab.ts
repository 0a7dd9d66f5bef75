/** Texts of the fleet on other pages; those of its own page are loaded with it. */
export const TEXT = {
  fleet: "Fleet",
};
