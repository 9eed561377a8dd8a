// Opens pages in a headless Chromium that has no network, and prints what became of each as JSON.
// node browser.mjs CHROMIUM FOLDER-OF-NODE-MODULES FOLDER-FOR-PICTURES PAGE…
import { createRequire } from 'node:module';
import { readFileSync, writeFileSync } from 'node:fs';
import { basename, join } from 'node:path';
import { pathToFileURL } from 'node:url';

const [chromium, modules, pictures, ...pages] = process.argv.slice(2);
const require = createRequire(join(modules, 'x.js'));
const puppeteer = require('puppeteer-core');
const axe = readFileSync(require.resolve('axe-core/axe.min.js'), 'utf8');
const RULES = { runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa'] };

const browser = await puppeteer.launch({
  executablePath: chromium,
  args: ['--no-sandbox', '--host-resolver-rules=MAP * ~NOTFOUND', '--disable-background-networking'],
});
const found = {};
for (const path of pages) {
  const name = basename(path, '.html');
  const said = { requests: [], messages: [], violations: {}, wide: {}, policy: 0 };
  for (const scheme of ['light', 'dark']) {
    for (const width of [1280, 390]) {
      const page = await browser.newPage();
      await page.evaluateOnNewDocument(() => {
        window.refused = 0;
        document.addEventListener('securitypolicyviolation', () => { window.refused += 1; });
      });
      page.on('request', (one) => said.requests.push(one.url().slice(0, 100)));
      page.on('console', (one) => said.messages.push(one.text()));
      page.on('pageerror', (one) => said.messages.push(String(one)));
      await page.setViewport({ width, height: width === 390 ? 844 : 900 });
      await page.emulateMediaFeatures([{ name: 'prefers-color-scheme', value: scheme }]);
      await page.goto(pathToFileURL(path).href, { waitUntil: 'load' });
      said.policy += await page.evaluate(() => window.refused);
      said.wide[`${scheme} ${width}`] = await page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
      await page.screenshot({ path: join(pictures, `${name}-${scheme}-${width}.png`), fullPage: true });
      for (const open of [false, true]) {
        await page.evaluate((all) => { for (const one of document.querySelectorAll('details')) one.open = all || one.open; }, open);
        await page.evaluate(axe);
        const result = await page.evaluate((rules) => window.axe.run(document, rules), RULES);
        const faults = result.violations.map((one) => `${one.id}: ${one.nodes.slice(0, 3).map((node) => node.html.slice(0, 160)).join(' | ')}`);
        said.violations[`${scheme} ${width}${open ? ' open' : ''}`] = faults;
        said.rules = result.passes.length;
      }
      if (width === 1280 && scheme === 'light') {
        await page.reload();
        said.opened = await page.evaluate(() => document.querySelector('details:not([open]) > summary')?.focus() ?? 0);
        const folded = await page.$('details:not([open]) > summary');
        if (folded) {
          await folded.focus();
          await page.keyboard.press('Enter');
          said.keyboard = await folded.evaluate((one) => one.parentElement.open);
        }
        await page.emulateMediaType('print');
        said.hidden = await page.evaluate(() => [...document.querySelectorAll('details table, details pre')]
          .filter((one) => one.getBoundingClientRect().height === 0).length);
        writeFileSync(join(pictures, `${name}.pdf`), await page.pdf({ format: 'A4' }));
        said.text = await page.evaluate(() => document.body.innerText.length);
      }
      await page.close();
    }
  }
  found[name] = said;
}
await browser.close();
process.stdout.write(JSON.stringify(found));
