// Requests to the app's server. A tab has a name of its own; only one tab of a folder may change anything.

// The name outlives a reload, and is stored during one only: a duplicated tab copies what is stored.
export const TAB = sessionStorage.getItem("tab") ?? crypto.randomUUID();
sessionStorage.removeItem("tab");
addEventListener("pagehide", () => sessionStorage.setItem("tab", TAB));
addEventListener("pageshow", () => sessionStorage.removeItem("tab"));

export class Refused extends Error {}

async function answered(address, options) {
  let answer;
  try {
    answer = await fetch(address, { ...options, headers: { "x-tab": TAB, ...options?.headers } });
  } catch {
    throw new Refused("scleraforce app has ended; start it again");
  }
  if (!answer.ok) throw new Refused((await answer.text()) || `refused (${answer.status})`);
  return answer;
}

const query = (names) => new URLSearchParams(names).toString();

export const get = async (path, names = {}) => (await answered(`api/${path}?${query({ ...names, tab: TAB })}`)).json();

const sent = (path, body, names, method = "POST") =>
  answered(`api/${path}?${query(names)}`, { method, body: JSON.stringify(body), headers: { "content-type": "application/json" } });

export const send = async (path, body, names = {}, method = "POST") => (await sent(path, body, names, method)).json();

export const erase = async (path, names = {}) => (await answered(`api/${path}?${query(names)}`, { method: "DELETE", body: "" })).json();

export const picture = async (path, body, names) => createImageBitmap(await (await sent(path, body, names)).blob());

export const frame = async (names) => createImageBitmap(await (await answered(`api/frame?${query(names)}`)).blob());

export const thumbnail = (name, file) => `api/frame?${query({ name, file, height: 66 })}`;

// Sends a file; `progress` is called with the share that has been sent.
export function upload(file, progress) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("PUT", `api/source?${query({ name: file.name })}`);
    request.setRequestHeader("x-tab", TAB);
    request.upload.onprogress = (event) => progress(event.loaded / Math.max(event.total, 1));
    request.onload = () => (request.status === 200 ? resolve(JSON.parse(request.response)) : reject(new Refused(request.response)));
    request.onerror = () => reject(new Refused(`${file.name}: could not be sent; drop files, not folders`));
    request.send(file);
  });
}
