/** Texts about extensions of other packages. */
export const TEXT = {
  failed: (title: string, why: string) => `${title} cannot be shown on this page: ${why}.`,
  failedHint: "Everything else works. Install another version of its package, or remove it.",
};
