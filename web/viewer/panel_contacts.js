// @ts-check
/** Contacts panel: the list with thumbnails, editing, export; and the small form that drops a contact. */

import { make, saveBlob, setText } from '../shared/dom.js';
import { dateTime, fixed, geodetic } from '../shared/format.js';
import { contactsCsv } from './contacts.js';
import { confirmed, toast } from './dialogs.js';
import { displayLevel } from './gain.js';

/** @typedef {import('./contacts.js').Contact} Contact */
/** @typedef {import('./contacts.js').ContactList} ContactList */
/** @typedef {import('./waterfall.js').Waterfall} Waterfall */

/** Half the size of a thumbnail in the water: metres across, seconds along. */
const THUMB_REACH_M = 3;
const THUMB_REACH_S = 4;

export class ContactsPanel {
  /**
   * @param {HTMLElement} root
   * @param {ContactList} list
   * @param {Waterfall} waterfall
   * @param {import('./contact_desk.js').ContactDesk} actions
   */
  constructor(root, list, waterfall, actions) {
    this.list = list;
    this.waterfall = waterfall;
    this.actions = actions;
    /** @type {Map<string, HTMLCanvasElement>} */
    this.thumbnails = new Map();
    this.count = make('p', { class: 'hint' });
    this.rows = make('ul', { 'aria-label': 'Contacts' });
    const button = (/** @type {string} */ text, /** @type {() => void} */ click, kind = '') =>
      make('button', { class: `button ${kind}`.trim(), type: 'button', text, on: { click } });
    root.append(
      this.count,
      make(
        'div',
        { class: 'buttons' },
        button('New contact at the cursor', () => actions.dropAtCursor(), 'wide'),
        button('Save CSV', () => this.export('csv')),
        button('Save JSON', () => this.export('json')),
      ),
      this.rows,
    );
    this.refresh();
  }

  refresh() {
    const { contacts } = this.list;
    setText(
      this.count,
      contacts.length
        ? `${contacts.length} kept with the recording`
        : 'None yet. Click an echo, or tap it and use the button.',
    );
    // A name being typed is not torn away by an update from elsewhere.
    if (this.rows.contains(document.activeElement) && document.activeElement instanceof HTMLInputElement)
      return;
    this.rows.replaceChildren(...contacts.toReversed().map((contact) => this.row(contact)));
  }

  /** @param {Contact} contact */
  row(contact) {
    const name = make('input', {
      class: 'field',
      value: contact.name,
      maxlength: 80,
      'aria-label': 'Name of the contact',
    });
    name.addEventListener('change', () => this.rename(contact, name.value));
    name.addEventListener('keydown', (event) => event.key === 'Enter' && name.blur());
    const side = contact.channel === 'A' ? 'starboard' : 'port';
    const place = contact.range_m === null ? side : `${fixed(contact.range_m, 1)} m ${side}`;
    const known = contact.latitude_deg !== null && contact.longitude_deg !== null;
    const position = known
      ? `, ${geodetic(contact.latitude_deg, 'latitude', 5)}, ${geodetic(contact.longitude_deg, 'longitude', 5)}`
      : '';
    const note = contact.note ? ` ${contact.note}` : '';
    return make(
      'li',
      { class: 'contact', dataset: { id: contact.id } },
      this.thumbnail(contact),
      name,
      make('p', { class: 'where', text: `${place}, ${dateTime(contact.time_unix_s)}${position}${note}` }),
      make(
        'div',
        { class: 'row' },
        make('button', {
          class: 'button',
          type: 'button',
          text: 'Show',
          on: { click: () => this.actions.goTo(contact) },
        }),
        make('button', {
          class: 'button danger',
          type: 'button',
          text: 'Delete',
          'aria-label': `Delete ${contact.name}`,
          on: { click: () => this.remove(contact) },
        }),
      ),
    );
  }

  /** @param {Contact} contact @param {string} name */
  async rename(contact, name) {
    if (!name.trim() || name === contact.name) return;
    await this.attempt(() => this.list.change(contact.id, { name: name.trim() }));
  }

  /** @param {Contact} contact */
  async remove(contact) {
    if (
      !(await confirmed('Delete this contact?', `${contact.name} is taken out of the recording.`, 'Delete'))
    )
      return;
    await this.attempt(() => this.list.remove(contact.id));
  }

  /** @param {() => Promise<void>} change */
  async attempt(change) {
    try {
      await change();
    } catch (error) {
      toast(error instanceof Error ? error.message : String(error), 'fault');
    }
  }

  /** @param {'csv' | 'json'} kind */
  export(kind) {
    const { contacts } = this.list;
    const text = kind === 'csv' ? contactsCsv(contacts) : JSON.stringify({ contacts }, null, 2);
    const type = kind === 'csv' ? 'text/csv' : 'application/json';
    saveBlob(new Blob([text], { type }), `contacts.${kind}`);
  }

  /** @param {Contact} contact from the pings in memory, made once; blank when they are not */
  thumbnail(contact) {
    const kept = this.thumbnails.get(contact.id);
    if (kept) return kept;
    const canvas = make('canvas', { width: 88, height: 64, 'aria-hidden': 'true' });
    const timeS = this.actions.timeOf(contact);
    if (
      contact.range_m !== null &&
      paintThumbnail(canvas, this.waterfall, contact.channel, contact.range_m, timeS)
    ) {
      this.thumbnails.set(contact.id, canvas);
    }
    return canvas;
  }
}

/**
 * @param {HTMLCanvasElement} canvas
 * @param {Waterfall} waterfall
 * @param {'A' | 'B'} channel
 * @param {number} rangeM
 * @param {number} timeS
 * @returns {boolean} whether there were pings to paint
 */
function paintThumbnail(canvas, waterfall, channel, rangeM, timeS) {
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext('2d'));
  const image = context.createImageData(canvas.width, canvas.height);
  const pixels = new Uint32Array(image.data.buffer);
  const palette = new Uint32Array(waterfall.table.slice().buffer);
  const mirrored = (channel === 'B') !== waterfall.view.swapped;
  const tvg = waterfall.levels.tvg[channel === 'A' ? 0 : 1];
  let painted = false;
  for (let y = 0; y < canvas.height; y++) {
    const rowS = timeS + (0.5 - y / canvas.height) * 2 * THUMB_REACH_S;
    for (const ring of waterfall.ringsOf(channel)) {
      const index = ring.lastAtOrBefore(rowS);
      if (index < 0 || rowS - ring.timeS[ring.slot(index)] > 1) continue;
      painted = true;
      for (let x = 0; x < canvas.width; x++) {
        const across = (x / canvas.width - 0.5) * 2 * THUMB_REACH_M * (mirrored ? -1 : 1);
        const amplitude = ring.amplitudeAt(ring.slot(index), rangeM + across);
        if (typeof amplitude !== 'number') continue;
        const bin = Math.min(
          tvg.length - 1,
          Math.floor(((rangeM + across) / waterfall.levels.tvgMaximumM) * tvg.length),
        );
        const level = displayLevel(amplitude, tvg[Math.max(0, bin)], waterfall.levels.gain);
        pixels[y * canvas.width + x] = palette[Math.round(255 * level)];
      }
      break;
    }
  }
  context.putImageData(image, 0, 0);
  return painted;
}

/**
 * The form that asks for the name of a new contact, at the click.
 * @param {HTMLFormElement} form
 * @param {{x: number, y: number}} at
 * @param {string} where shown above the name
 * @param {string} name proposed
 * @param {(name: string, note: string) => Promise<void>} save
 * @param {() => void} onClose
 */
export function askForContact(form, at, where, name, save, onClose) {
  const nameInput = make('input', {
    class: 'field',
    value: name,
    maxlength: 80,
    autocomplete: 'off',
    required: true,
  });
  const noteInput = make('input', { class: 'field', maxlength: 1000, autocomplete: 'off' });
  const close = () => {
    form.hidden = true;
    form.onsubmit = null;
    onClose();
  };
  form.replaceChildren(
    make('strong', { text: where }),
    make('label', {}, 'Name', nameInput),
    make('label', {}, 'Note', noteInput),
    make(
      'div',
      { class: 'buttons' },
      make('button', { class: 'button', type: 'button', text: 'Cancel', on: { click: close } }),
      make('button', { class: 'button primary', type: 'submit', text: 'Save' }),
    ),
  );
  form.onsubmit = async (event) => {
    event.preventDefault();
    if (!nameInput.value.trim()) return;
    try {
      await save(nameInput.value.trim(), noteInput.value.trim());
      close();
    } catch (error) {
      toast(error instanceof Error ? error.message : String(error), 'fault');
    }
  };
  form.onkeydown = (event) => {
    if (event.key !== 'Escape') return;
    event.stopPropagation();
    close();
  };
  form.hidden = false;
  const box = form.getBoundingClientRect();
  form.style.left = `${Math.max(8, Math.min(at.x + 12, window.innerWidth - box.width - 8))}px`;
  form.style.top = `${Math.max(8, Math.min(at.y + 12, window.innerHeight - box.height - 8))}px`;
  nameInput.focus();
  nameInput.select();
}
