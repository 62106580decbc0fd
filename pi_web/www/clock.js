// What time it is for the page: now, or that of a recording.

let source = () => Date.now();

export const now = () => source();  // [ms]
export function setClock(given) { source = given; }
