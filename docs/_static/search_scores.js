/* Order of the search's results: pages for users first, then the API, then pages about the development.

Sphinx puts this file into its own search; the numbers of `Scorer` are Sphinx's. */
var Scorer = {
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,

  score: ([page, , , , score, , kind]) => {
    if (/^docs\/(decisions|architecture|versioning)|^(validation|release|CHANGELOG|CONTRIBUTING)/.test(page))
      return score / 10;
    if (kind === "object" && page.startsWith("docs/api/") && score < 12) return score / 5;  // a part of a name
    if (/^docs\/(how-to|tutorial|troubleshooting|glossary|conventions)/.test(page)) return 1.5 * score;
    return score;
  },
};
