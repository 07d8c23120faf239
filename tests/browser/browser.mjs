// Drives a browser by lines of JSON: {"open": URL}, {"wait": JS}, {"press": KEY}, {"width": PIXELS}, {"click": CSS},
// {"path": [[X, Y], …]} (press there, move, release), {"fill": [CSS, TEXT]},
// {"requests": true}, {"dialogs": true}. Dialogs are accepted. Each is answered by a line of JSON. Ends with its input.
import { createInterface } from "node:readline";
import puppeteer from "puppeteer-core";

const browser = await puppeteer.launch({
  executablePath: process.argv[2],
  args: ["--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking"],
});
const page = await browser.newPage();
const requests = [], complaints = [];
page.on("request", each => requests.push(each.url()));
let dialogs = [];
page.on("dialog", async each => { dialogs.push(each.message()); await each.accept(); });
page.on("pageerror", each => complaints.push(String(each)));
page.on("console", each => { if (each.type() === "error") complaints.push(each.text()); });

const steps = {
  open: async url => (await page.goto(url, { waitUntil: "domcontentloaded" })).status(),
  wait: async script => (await page.waitForFunction(script, { timeout: 60000, polling: 50 })).jsonValue(),
  press: async key => page.keyboard.press(key),
  width: async pixels => page.setViewport({ width: pixels, height: 700 }),
  path: async ([[x, y], ...rest]) => {
    await page.mouse.move(x, y);
    await page.mouse.down();
    for (const [x, y] of rest) await page.mouse.move(x, y, { steps: 8 });
    await page.mouse.up();
  },
  fill: async ([selector, text]) => {
    await page.$eval(selector, each => { each.focus(); each.select(); });  // wherever it has moved meanwhile
    await page.keyboard.type(text);
    await page.keyboard.press("Enter");
  },
  click: async selector => page.$eval(selector, each => each.click()),  // wherever it has moved meanwhile
  dialogs: async () => dialogs,
  requests: async () => requests,
  complaints: async () => complaints,
  picture: async path => page.screenshot({ path }).then(() => null),
};
try {
  for await (const line of createInterface({ input: process.stdin })) {
    const [[step, argument]] = Object.entries(JSON.parse(line));
    console.log(JSON.stringify((await steps[step](argument)) ?? null));
  }
} finally {
  await browser.close();
}
