// Requests to the program. The token goes in a header, so that no address but the printed one ever holds it.

/** The program refused or could not answer: what it said, and what can be done about it. */
export class Refusal extends Error {
  constructor(readonly status: number, message: string, readonly hint: string) {
    super(message);
  }
}

/** Nobody answers any more. */
export class Lost extends Error {}

export class Api {
  constructor(private token: string, private readonly alive: (alive: boolean) => void) {}

  private async send(path: string, signal?: AbortSignal, more: RequestInit = {}): Promise<Response> {
    let response: Response;
    const headers = { Authorization: `Bearer ${this.token}`, ...(more.headers as Record<string, string> | undefined) };
    try {
      response = await fetch(path, { ...more, headers, signal, cache: 'no-store' });
    } catch (cause) {
      if (signal?.aborted) throw cause;
      this.alive(false);
      throw new Lost('no answer');
    }
    this.alive(true);
    if (response.ok) return response;
    const said = (await response.json().catch(() => ({}))) as { error?: string; hint?: string };
    throw new Refusal(response.status, said.error ?? `${response.status} ${response.statusText}`, said.hint ?? '');
  }

  async json<T>(path: string, signal?: AbortSignal): Promise<T> {
    return (await this.send(path, signal)).json() as Promise<T>;
  }

  async bytes(path: string, signal?: AbortSignal): Promise<ArrayBuffer> {
    return (await this.send(path, signal)).arrayBuffer();
  }

  /** A document with its version. */
  async versioned(path: string): Promise<{ bytes: ArrayBuffer; version: string }> {
    const response = await this.send(path);
    return { bytes: await response.arrayBuffer(), version: response.headers.get('ETag') ?? '' };
  }

  /** Puts a document in the place of the version it was made from, or takes it away; its new version. */
  async change(path: string, version: string, body: BodyInit | null, kind = ''): Promise<string> {
    const headers = { 'If-Match': version, ...(body === null ? {} : { 'Content-Type': kind }) };
    const response = await this.send(path, undefined, { method: body === null ? 'DELETE' : 'PUT', headers, body });
    return response.headers.get('ETag') ?? '';
  }

  /** The program was started anew, with another token. */
  renew(token: string): void {
    this.token = token;
  }

  async picture(path: string, signal?: AbortSignal): Promise<ImageBitmap> {
    return createImageBitmap(await (await this.send(path, signal)).blob());
  }
}

/**
 * The token of the printed address, else the one this tab had before. The address bar loses it: what is copied from there
 * or seen over a shoulder gives nothing away, and a reload still works.
 */
export function takeToken(): string {
  const here = new URL(location.href);
  const given = here.searchParams.get('token');
  const place = `strandflow ${here.host}`;
  if (given === null) return sessionStorage.getItem(place) ?? '';
  sessionStorage.setItem(place, given);
  here.searchParams.delete('token');
  history.replaceState(null, '', here);
  return given;
}
