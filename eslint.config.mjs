import js from '@eslint/js';
import globals from 'globals';

export default [
  { ignores: ['web/vendor/', 'node_modules/'] },
  js.configs.recommended,
  {
    files: ['web/**/*.js'],
    languageOptions: { globals: globals.browser },
    rules: { eqeqeq: 'error', 'no-var': 'error', 'prefer-const': 'error' },
  },
  { files: ['scripts/**/*.mjs', 'web/test/**/*.js'], languageOptions: { globals: globals.node } },
];
