"""Style and script of the page of a batch: nothing is loaded from elsewhere."""

STYLE = """
:root { color-scheme: light dark; --back: #fff; --text: #1c1e21; --dim: #667; --line: #dfe2e6;
  --head: #f4f5f7; --bad: #b3261e; --bad-back: #fdecea; --link: #1a5fb4; }
@media (prefers-color-scheme: dark) { :root { --back: #16181c; --text: #dcdfe4; --dim: #99a;
  --line: #33363d; --head: #20232a; --bad: #ff8a80; --bad-back: #3a1d1b; --link: #8ab4f8; } }
* { box-sizing: border-box; }
body { font: 14px/1.4 system-ui, sans-serif; margin: 0 auto; max-width: 110em;
  padding: 1em 1.2em 4em; background: var(--back); color: var(--text); }
h1 { font-size: 1.5em; margin: .3em 0 0; } header p { margin: .2em 0 .8em; font-size: 1.1em; }
a { color: var(--link); } small { color: var(--dim); font-weight: normal; }
nav { position: sticky; top: 0; z-index: 3; display: flex; flex-wrap: wrap; gap: .4em;
  align-items: center; padding: .6em 0; background: var(--back);
  border-bottom: 1px solid var(--line); }
nav a { padding: .15em .7em; border: 1px solid var(--line); border-radius: 1em;
  text-decoration: none; white-space: nowrap; }
nav .bad { color: var(--bad); border-color: var(--bad); }
input { flex: 1 0 9em; max-width: 20em; margin-left: auto; padding: .3em .6em; font: inherit; }
details { scroll-margin-top: 3.5em; } summary { cursor: pointer; margin: 1.4em 0 .4em; }
summary h2 { display: inline; font-size: 1.2em; } #failed h2 { color: var(--bad); }
.wide { overflow-x: auto; }
table { border-collapse: separate; border-spacing: 0; }
th, td { text-align: left; vertical-align: top; padding: .35em .8em .35em 0;
  border-bottom: 1px solid var(--line); }
thead th { vertical-align: bottom; background: var(--head); }
tbody th { font-weight: 600; overflow-wrap: break-word; }
th:first-child { padding-left: .5em; position: sticky; left: 0; background: var(--back);
  min-width: 12em; max-width: 22em; }
.sortable th:first-child { min-width: 19em; }
thead th:first-child { background: var(--head); }
#failed tbody tr, #failed tbody tr > * { background: var(--bad-back); }
#failed td:last-child { min-width: 20em; }
.sortable td { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
.sortable thead th { text-align: right; max-width: 7em; }
.sortable thead th:is(:first-child, :last-child) { text-align: left; max-width: none; }
.sortable td:last-child { text-align: left; white-space: normal; }
.sortable :is(th, td):last-child { padding-left: .8em; }
td p { width: 27em; margin: 0; color: var(--dim); font-size: .93em; cursor: pointer;
  overflow: hidden; display: -webkit-box; -webkit-box-orient: vertical; -webkit-line-clamp: 4; }
td p:focus { -webkit-line-clamp: none; outline: none; }
tbody th div { display: flex; gap: .8em; } tbody th span { min-width: 0; }
tbody th small { white-space: nowrap; } tbody th small a { margin-right: .5em; }
img { display: block; width: 112px; height: 84px; object-fit: contain; background: #fff;
  border-radius: 3px; }
button { all: unset; cursor: pointer; } button:focus-visible { outline: 2px solid var(--link); }
[aria-sort=ascending] button::after { content: " \\25B2"; }
[aria-sort=descending] button::after { content: " \\25BC"; }
tr[hidden] { display: none; }
@media (max-width: 600px) { body { padding: .6em .6em 3em; } nav { position: static; }
  th:first-child, .sortable th:first-child { min-width: 8.5em; max-width: 8.5em; }
  tbody th div { display: block; } tbody th { font-size: .93em; } img { width: 100%; height: auto; }
  input { margin-left: 0; max-width: none; } nav a { padding: .3em .8em; }
  #failed :is(table, tbody, tr, th, td) { display: block; min-width: 0; max-width: none; }
  #failed :is(th, td:nth-child(2)) { display: inline-block; }
  #failed thead { display: none; } #failed tr > * { padding: .25em .6em; border: 0; }
  #failed tr { border-bottom: 1px solid var(--line); } }
"""

SCRIPT = """
const key = cell => {
  const text = cell.dataset.value ?? cell.textContent;
  return text === '' ? NaN : Number(text);
};
for (const table of document.querySelectorAll('.sortable'))
  table.tHead.addEventListener('click', event => {
    const head = event.target.closest('th');
    if (!head) return;
    const up = head.getAttribute('aria-sort') !== 'ascending';
    for (const other of head.parentNode.children) other.setAttribute('aria-sort', 'none');
    head.setAttribute('aria-sort', up ? 'ascending' : 'descending');
    const place = head.cellIndex, body = table.tBodies[0];
    const rows = [...body.rows].map(row => [row, row.cells[place]]);
    const words = rows.some(([row, cell]) => cell.textContent !== '' && isNaN(key(cell)));
    const name = cell => cell.parentNode.cells[place].textContent;
    const order = ([, a], [, b]) => {
      if (words) return (up ? 1 : -1) * name(a).localeCompare(name(b), 'en', {numeric: true});
      const x = key(a), y = key(b);
      return isNaN(x) - isNaN(y) || (up ? x - y : y - x);
    };
    body.append(...rows.sort(order).map(([row]) => row));
  });
document.querySelector('input').addEventListener('input', event => {
  const wanted = event.target.value.toLowerCase();
  for (const row of document.querySelectorAll('tr[data-shape]'))
    row.hidden = !row.dataset.shape.toLowerCase().includes(wanted);
});
document.querySelector('nav').addEventListener('click', event => {
  const name = event.target.closest('a')?.getAttribute('href');
  if (name) document.querySelector(name).open = true;
});
"""
