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
