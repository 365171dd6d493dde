// @ts-check
// A card of the live page: title, health of its sensor, age of its data.

import { make, setAttribute, setText } from '../shared/dom.js';
import { STATE_WORDS, asState, showState, stateIcon } from '../shared/status_icons.js';
import { STALE_S } from './model.js';
import { cardAge } from './value_cell.js';

export class Card {
  /**
   * @param {string} id
   * @param {string} title
   * @param {string | null} chip  id of the chip that tells this card's health
   */
  constructor(id, title, chip) {
    this.chip = chip;
    this.icon = chip ? stateIcon() : null;
    this.word = make('span', { class: 'visually-hidden' });
    this.ageText = make('span', { class: 'card-age' });
    this.head = make(
      'header',
      { class: 'card-head' },
      make('h2', { text: title, id: `card-${id}-title` }),
      this.icon,
      this.word,
      this.ageText,
    );
    this.root = make(
      'section',
      { class: `card card-${id}`, 'aria-labelledby': `card-${id}-title` },
      this.head,
    );
  }

  /** @param {...(Node | string)} nodes */
  add(...nodes) {
    this.root.append(...nodes);
    return this;
  }

  /**
   * @param {Record<string, any> | null} status
   * @param {number | null} seconds  age of the newest data
   */
  update(status, seconds) {
    setText(this.ageText, cardAge(seconds));
    this.root.classList.toggle('stale', seconds !== null && seconds > STALE_S);
    if (!this.icon) return;
    const chips = Array.isArray(status?.chips) ? status.chips : [];
    const chip = chips.find((candidate) => candidate?.id === this.chip);
    const state = asState(chip?.state);
    showState(this.icon, state);
    setText(this.word, STATE_WORDS[state]);
    setAttribute(this.icon, 'title', `${STATE_WORDS[state]}${chip?.cause ? `: ${chip.cause}` : ''}`);
  }
}
