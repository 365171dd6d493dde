// @ts-check
/** The viewer page, wired: feed to waterfall, hands to view, panels to service. */

import { byId } from '../shared/dom.js';
import { ViewerPage } from './page.js';

const page = new ViewerPage(byId('stage', HTMLElement));
page.start();
// For tests and for a look from the console.
Object.assign(window, { viewer: page });
