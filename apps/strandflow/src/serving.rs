//! What `view` and `annotate` do alike: a port, an address, Ctrl-C.

use std::io::ErrorKind;

use strandflow_view::{Server, Token, describe::Note, page};

use crate::{failure::Failed, stdout::print};

/// The port where none is asked for: the same every time, so that a tunnel can be set up once.
const PORT: u16 = 8470;
/// Requests worked on at once: more than the browser sends would only take memory.
const MOST_THREADS: usize = 8;

/// Binds a port, prints the address of the page and what there is to say, and lets Ctrl-C end the server.
pub fn begin(port: Option<u16>, about_it: &str, notes: &[Note]) -> Result<Server, Failed> {
    let server = bind(port)?;
    let stop = server.stopper();
    ctrlc::set_handler(move || stop.stop()).map_err(|error| Failed {
        error: error.to_string(),
        hint: String::new(),
        input: false,
    })?;
    print(&format!("{}\n", server.url()))?;
    let port = server.port();
    eprintln!("Open that address in a browser on this machine. From another one, run there first");
    eprintln!("  ssh -N -L {port}:127.0.0.1:{port} USER@THIS_MACHINE");
    eprintln!("and open the same address there. {about_it}");
    if !page::IS_BUILT {
        eprintln!("notice: this program was built without its page: {}", page::HOW_TO_BUILD);
    }
    for note in notes {
        eprintln!("notice: {}\nhint: {}", note.fact, note.hint);
    }
    Ok(server)
}

/// Requests worked on at once.
pub fn threads() -> usize {
    std::thread::available_parallelism().map_or(2, usize::from).clamp(2, MOST_THREADS)
}

/// The port asked for; else the usual one, or any if that is in use.
fn bind(port: Option<u16>) -> Result<Server, Failed> {
    let token = Token::random()?;
    match (Server::bind(port.unwrap_or(PORT), token.clone()), port) {
        (Ok(server), _) => Ok(server),
        (Err(error), None) if error.kind() == ErrorKind::AddrInUse => Ok(Server::bind(0, token)?),
        (Err(error), _) => {
            let port = port.unwrap_or(PORT);
            let fact = match error.kind() {
                ErrorKind::AddrInUse => "is in use".to_owned(),
                _ => format!("cannot be had: {error}"),
            };
            Err(Failed::input(format!("port {port} {fact}"), "give another --port, or 0 for any free one"))
        }
    }
}
