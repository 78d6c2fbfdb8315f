// Requests to the app's server. A tab has a name of its own; only one tab of a folder may change anything.

export const TAB = sessionStorage.getItem("tab") ?? crypto.randomUUID();
sessionStorage.setItem("tab", TAB);

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

export async function send(path, body, names = {}, method = "POST") {
  const options = { method, body: JSON.stringify(body), headers: { "content-type": "application/json" } };
  return (await answered(`api/${path}?${query(names)}`, options)).json();
}

export const erase = async (path, names = {}) => (await answered(`api/${path}?${query(names)}`, { method: "DELETE", body: "" })).json();

export async function picture(path, body, names) {
  const options = { method: "POST", body: JSON.stringify(body), headers: { "content-type": "application/json" } };
  return createImageBitmap(await (await answered(`api/${path}?${query(names)}`, options)).blob());
}

export async function frame(names) {
  return createImageBitmap(await (await answered(`api/frame?${query(names)}`)).blob());
}

export const thumbnail = (name, file) => `api/frame?${query({ name, file, height: 66 })}`;

// A file is sent as it is read; `progress` is told the share that has gone.
export function upload(file, progress) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("PUT", `api/source?${query({ name: file.name })}`);
    request.setRequestHeader("x-tab", TAB);
    request.upload.onprogress = (event) => progress(event.loaded / Math.max(event.total, 1));
    request.onload = () => (request.status === 200 ? resolve(JSON.parse(request.response)) : reject(new Refused(request.response)));
    request.onerror = () => reject(new Refused(`${file.name}: not sent`));
    request.send(file);
  });
}
