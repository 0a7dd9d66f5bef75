/** Texts of the guide within the page. */
export const TEXT = {
  guide: "Guide",
  open: "Open the guide",
  search: "Search the guide",
  pages: "Pages of the guide",
  noMatch: "No page has all of these words.",
};
