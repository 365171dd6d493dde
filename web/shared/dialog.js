// @ts-check
// A question that needs an answer before something is lost.

import { make } from './dom.js';

/**
 * @param {{title: string, lines: string[], action: string, danger?: boolean}} question
 * @returns {Promise<boolean>} whether the action was chosen; Escape and Cancel mean no
 */
export function ask(question) {
  return new Promise((resolve) => {
    const cancel = make('button', { class: 'button', type: 'submit', value: 'no', text: 'Cancel' });
    const act = make('button', {
      class: question.danger ? 'button danger' : 'button primary',
      type: 'submit',
      value: 'yes',
      text: question.action,
    });
    const dialog = make(
      'dialog',
      { class: 'dialog', 'aria-label': question.title },
      make(
        'form',
        { method: 'dialog' },
        make('h2', { text: question.title }),
        ...question.lines.map((line) => make('p', { text: line })),
        make('div', { class: 'dialog-actions' }, cancel, act),
      ),
    );
    dialog.addEventListener('close', () => {
      dialog.remove();
      resolve(dialog.returnValue === 'yes');
    });
    document.body.append(dialog);
    dialog.showModal();
    cancel.focus();
  });
}
