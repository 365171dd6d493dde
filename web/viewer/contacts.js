// @ts-check
/** Named contacts: the list as the service keeps it, and its export. */

import { call } from '../shared/api.js';

/**
 * @typedef {object} Contact
 * @property {string} id
 * @property {string} name
 * @property {string} note
 * @property {'A' | 'B'} channel
 * @property {number | null} ping_number
 * @property {number | null} range_m
 * @property {number | null} time_unix_s
 * @property {number | null} latitude_deg
 * @property {number | null} longitude_deg
 * @property {number | null} position_within_m radius of 95 %, null unknown
 * @property {number | null} ground_range_m null: the position was made with the slant range
 */

/** @type {(keyof Contact)[]} */
export const CONTACT_COLUMNS = [
  'id',
  'name',
  'note',
  'channel',
  'ping_number',
  'range_m',
  'time_unix_s',
  'latitude_deg',
  'longitude_deg',
  'position_within_m',
  'ground_range_m',
];

/**
 * @param {any} answer of GET /api/contacts: a list, or an object that holds it
 * @returns {Contact[]} only those that can be shown
 */
export function contactsOf(answer) {
  const list = Array.isArray(answer) ? answer : answer?.contacts;
  if (!Array.isArray(list)) return [];
  return list.filter(
    (item) => item && item.id !== undefined && (item.channel === 'A' || item.channel === 'B'),
  );
}

/** @param {Contact[]} contacts */
export function contactsCsv(contacts) {
  const rows = contacts.map((contact) => CONTACT_COLUMNS.map((key) => csvField(contact[key])).join(','));
  return [CONTACT_COLUMNS.join(','), ...rows, ''].join('\r\n');
}

/**
 * One CSV field; what a spreadsheet would run as a formula is made text.
 * @param {unknown} value
 */
function csvField(value) {
  if (value === null || value === undefined) return '';
  let text = String(value);
  if (typeof value === 'string' && /^[=+\-@\t]/.test(text)) text = `'${text}`;
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

/**
 * The first "Contact N" that nobody has.
 * @param {Contact[]} contacts
 */
export function nextName(contacts) {
  const names = new Set(contacts.map((contact) => contact.name));
  for (let k = contacts.length + 1; ; k++) if (!names.has(`Contact ${k}`)) return `Contact ${k}`;
}

/** The service's list, and the calls that change it. */
export class ContactList {
  constructor() {
    /** @type {Contact[]} */
    this.contacts = [];
    /** @type {() => void} */
    this.onChange = () => {};
  }

  async refresh() {
    this.contacts = contactsOf(await call('api/contacts'));
    this.onChange();
  }

  /** @param {Omit<Contact, 'id'>} contact */
  async add(contact) {
    await call('api/contacts', { method: 'POST', body: contact });
    await this.refresh();
  }

  /** @param {string} id @param {Partial<Contact>} change */
  async change(id, change) {
    await call(`api/contacts/${encodeURIComponent(id)}`, { method: 'PATCH', body: change });
    await this.refresh();
  }

  /** @param {string} id */
  async remove(id) {
    await call(`api/contacts/${encodeURIComponent(id)}`, { method: 'DELETE' });
    await this.refresh();
  }
}
