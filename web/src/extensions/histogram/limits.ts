/** Limits of what is set of a histogram, as the server has them (server/extensions/analysis/methods/histogram.py). */
export const BINS = [1, 2000] as const;
export const SIGMAS = [0.5, 100] as const;
