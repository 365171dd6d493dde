// @ts-check
/** Contacts on the picture: dropping, marking, finding them again. */

import { fixed } from '../shared/format.js';
import { ContactList, nextName } from './contacts.js';
import { toast } from './dialogs.js';
import { askForContact } from './panel_contacts.js';
import { positionOf } from './readout.js';

/** @typedef {import('./overlay.js').Spot} Spot */
/** @typedef {import('./contacts.js').Contact} Contact */

export class ContactDesk {
  /**
   * @param {import('./stage.js').Stage} stage
   * @param {import('./track.js').Track} track
   * @param {HTMLFormElement} form that asks for the name
   * @param {(topS: number) => void} showTop moves the picture
   */
  constructor(stage, track, form, showTop) {
    this.stage = stage;
    this.waterfall = stage.waterfall;
    this.overlay = stage.overlay;
    this.track = track;
    this.form = form;
    this.showTop = showTop;
    this.list = new ContactList();
    this.asking = false;
    /** @type {string | null} */
    this.selectedId = null;
    /** @type {(contacts: Contact[]) => void} */
    this.onChange = () => {};
    this.list.onChange = () => {
      this.placeMarkers();
      this.onChange(this.list.contacts);
    };
  }

  dropAtCursor() {
    const { cursor } = this.overlay;
    const at = cursor && this.overlay.locate(cursor);
    if (!cursor || !at) {
      toast('First put the cursor on an echo: tap it, or Shift and the arrows.');
      return;
    }
    const box = this.stage.element.getBoundingClientRect();
    this.ask(cursor, { x: box.left + at.x, y: box.top + at.y });
  }

  /** @param {Spot} spot @param {{x: number, y: number}} at of the window */
  ask(spot, at) {
    this.overlay.cursor = { ...spot };
    this.asking = true;
    this.waterfall.invalidate();
    // Read now: the ping may have left memory by the time the name is typed.
    const contact = this.contactAt(spot);
    askForContact(
      this.form,
      at,
      `${fixed(spot.rangeM, 1)} ${this.overlay.unit} ${spot.channel === 'A' ? 'starboard' : 'port'}`,
      nextName(this.list.contacts),
      async (name, note) => {
        await this.list.add({ ...contact, name, note });
        toast(`${name} saved`);
      },
      () => {
        this.asking = false;
        this.stage.element.focus({ preventScroll: true });
      },
    );
  }

  /** @param {Spot} spot */
  contactAt(spot) {
    const pane = this.waterfall.panes.find((candidate) => candidate.channel === spot.channel);
    const ping = pane ? this.waterfall.pingAt(pane, this.waterfall.yAtTime(pane, spot.timeS)) : -1;
    const position = positionOf(spot, this.track);
    const unixS = spot.timeS + this.overlay.unixOffsetS;
    return {
      channel: spot.channel,
      ping_number: typeof ping === 'number' ? null : ping.ring.number[ping.slot],
      range_m: Math.round(spot.rangeM * 1000) / 1000,
      time_unix_s: Number.isFinite(unixS) ? unixS : null,
      latitude_deg: position?.latitudeDeg ?? null,
      longitude_deg: position?.longitudeDeg ?? null,
      position_within_m: rounded(position?.withinM),
      ground_range_m: rounded(position?.groundM),
    };
  }

  /** @param {Contact} contact on the page's time axis; NaN while the wall clock is unknown */
  timeOf(contact) {
    return (contact.time_unix_s ?? NaN) - this.overlay.unixOffsetS;
  }

  placeMarkers() {
    this.overlay.markers = this.list.contacts
      .filter((contact) => contact.range_m !== null && Number.isFinite(this.timeOf(contact)))
      .map((contact) => ({
        spot: { channel: contact.channel, rangeM: contact.range_m ?? 0, timeS: this.timeOf(contact) },
        name: contact.name,
        selected: contact.id === this.selectedId,
      }));
    this.waterfall.invalidate();
  }

  /** @param {Contact} contact */
  goTo(contact) {
    const timeS = this.timeOf(contact);
    if (!Number.isFinite(timeS)) {
      toast('The time of this contact is not known, so it cannot be shown.', 'fault');
      return;
    }
    this.selectedId = contact.id;
    this.placeMarkers();
    this.showTop(timeS + this.waterfall.windowS / 2);
  }
}

/** @param {number | null | undefined} metres to the centimetre */
function rounded(metres) {
  return typeof metres === 'number' ? Math.round(metres * 100) / 100 : null;
}
