// @ts-check
// HTTP calls by relative address; a refusal becomes an Error whose message is the server's own cause and cure.

/**
 * @param {string} path  relative, e.g. "api/settings"
 * @param {{method?: string, body?: unknown, headers?: Record<string, string>, timeoutMs?: number}} [options]
 * @returns {Promise<any>}
 */
export async function call(path, options = {}) {
  const headers = { ...options.headers };
  if (options.body !== undefined) headers['Content-Type'] = 'application/json';
  let response;
  try {
    response = await fetch(path, {
      method: options.method ?? 'GET',
      headers,
      body: options.body === undefined ? undefined : JSON.stringify(options.body),
      signal: AbortSignal.timeout(options.timeoutMs ?? 10000),
      cache: 'no-store',
    });
  } catch {
    throw new Error(
      'The extension did not answer. Check the tether and that the extension is running, then try again.',
    );
  }
  const text = await response.text();
  let answer = null;
  try {
    answer = text ? JSON.parse(text) : null;
  } catch {
    // Not JSON: a proxy's own error page. The status below says enough.
  }
  if (response.ok) return answer;
  throw new Error(
    answer?.error ?? `The extension answered ${response.status} ${response.statusText} to ${path}.`,
  );
}
