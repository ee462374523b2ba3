//! Bearer tokens: secrets that identify callers and their roles.

use super::access::Role;
use super::files::{FileError, RELOAD_PERIOD, read, stamp};
use crate::secret::Secret;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tokio::sync::watch;
use toml::{Table, Value};
use tracing::{info, warn};

/// Least length of a secret, bytes.
const MIN_SECRET_LEN: usize = 16;

/// Why a file of tokens cannot be used.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the texts say what the variants mean")]
pub enum TokenFileError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error("cannot use the tokens in {}: {reason}", path.display())]
    Refused { path: PathBuf, reason: TokenError },
}

/// Why a list of tokens is refused. No variant carries a secret.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[expect(missing_docs, reason = "the texts say what the variants mean")]
pub enum TokenError {
    #[error("line {line} is not TOML")]
    Syntax { line: usize },
    #[error("the key `{0}` is unknown: write [[token]] entries with name, role and secret")]
    UnknownKey(String),
    #[error("there is no [[token]] entry")]
    Empty,
    #[error("token {position} needs a string `{key}`")]
    Missing { position: usize, key: &'static str },
    #[error("token `{0}` has an unknown role: use client, worker, designer or admin")]
    Role(String),
    #[error("the secret of token `{0}` is shorter than {MIN_SECRET_LEN} bytes")]
    Short(String),
    #[error("the secret of token `{0}` may contain only visible ASCII characters")]
    InvalidCharacter(String),
    #[error("tokens `{0}` and `{1}` have the same name or secret")]
    Duplicate(String, String),
}

#[derive(Clone, PartialEq)]
struct Token {
    name: Arc<str>,
    role: Role,
    hash: blake3::Hash,
}

/// The tokens that an endpoint accepts. Only hashes of the secrets are kept. Clones share them, reloads included.
#[derive(Clone)]
pub struct Tokens {
    accepted: watch::Sender<Arc<[Token]>>,
    /// The file of the tokens, if there is one.
    path: Option<Arc<Path>>,
}

/// A token that was accepted.
#[derive(Clone)]
pub(super) struct Holder {
    token: Token,
    accepted: watch::Receiver<Arc<[Token]>>,
}

impl Holder {
    /// Name and role of the token.
    pub fn caller(&self) -> (Arc<str>, Role) {
        (self.token.name.clone(), self.token.role)
    }

    /// Whether the token is no longer accepted, or has another role.
    pub fn is_removed(&self) -> bool {
        !self.accepted.borrow().contains(&self.token)
    }

    /// Resolves some time after [`is_removed`](Self::is_removed) holds.
    pub async fn removed(mut self) {
        if self.accepted.wait_for(|tokens| !tokens.contains(&self.token)).await.is_err() {
            // The endpoint has stopped: its tokens can no longer change.
            std::future::pending().await
        }
    }
}

impl fmt::Debug for Tokens {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.accepted().iter().map(|token| (&token.name, token.role))).finish()
    }
}

impl Tokens {
    /// Reads a file of tokens.
    pub fn load(path: &Path) -> Result<Self, TokenFileError> {
        let text = String::from_utf8_lossy(&read(path)?).into_owned();
        let tokens = Self::parse(&text).map_err(|reason| TokenFileError::Refused { path: path.to_owned(), reason })?;
        Ok(Self { path: Some(path.into()), ..tokens })
    }

    /// Reloads the file whenever it changes, without end; returns at once if there is no file. If the file is invalid,
    /// the previous tokens stay in use.
    pub(super) async fn reload_on_change(&self) {
        let Some(path) = self.path.clone() else { return };
        let mut known = stamp(&path);
        loop {
            tokio::time::sleep(RELOAD_PERIOD).await;
            let now = stamp(&path);
            if now == known {
                continue;
            }
            known = now;
            match Self::load(&path) {
                Ok(tokens) => {
                    self.accepted.send_replace(tokens.accepted());
                    info!(path = %path.display(), ?tokens, "endpoint: tokens reloaded");
                }
                Err(error) => warn!(%error, "endpoint: cannot use the changed tokens; the previous ones stay in use"),
            }
        }
    }

    fn accepted(&self) -> Arc<[Token]> {
        self.accepted.borrow().clone()
    }

    /// Parses tokens: TOML with `[[token]]` entries of `name`, `role` and `secret`.
    pub fn parse(text: &str) -> Result<Self, TokenError> {
        // The parser's message may quote a line with a secret.
        let table = text.parse::<Table>().map_err(|error| {
            let before = error.span().and_then(|span| text.get(..span.start)).unwrap_or_default();
            TokenError::Syntax { line: before.matches('\n').count() + 1 }
        })?;
        if let Some(key) = table.keys().find(|key| *key != "token") {
            return Err(TokenError::UnknownKey(key.clone()));
        }
        let entries = table.get("token").and_then(Value::as_array).ok_or(TokenError::Empty)?;
        let mut tokens: Vec<Token> = Vec::with_capacity(entries.len());
        for (idx, entry) in entries.iter().enumerate() {
            let token = parse_token(entry, idx + 1)?;
            if let Some(twin) = tokens.iter().find(|other| other.name == token.name || other.hash == token.hash) {
                return Err(TokenError::Duplicate(twin.name.to_string(), token.name.to_string()));
            }
            tokens.push(token);
        }
        if tokens.is_empty() {
            return Err(TokenError::Empty);
        }
        Ok(Self { accepted: watch::Sender::new(tokens.into()), path: None })
    }

    /// Returns the token with this secret, in constant time.
    pub(super) fn holder(&self, secret: &str) -> Option<Holder> {
        let (hash, accepted) = (blake3::hash(secret.as_bytes()), self.accepted.subscribe());
        // All hashes are compared, each in constant time.
        let tokens = self.accepted();
        let found = tokens.iter().fold(None, |found, token| if token.hash == hash { Some(token) } else { found });
        found.map(|token| Holder { token: token.clone(), accepted })
    }
}

fn parse_token(entry: &Value, position: usize) -> Result<Token, TokenError> {
    let text = |key: &'static str| {
        let text = entry.get(key).and_then(Value::as_str).filter(|text| !text.is_empty());
        text.ok_or(TokenError::Missing { position, key })
    };
    let known = ["name", "role", "secret"];
    if let Some(key) = entry.as_table().and_then(|entry| entry.keys().find(|key| !known.contains(&key.as_str()))) {
        return Err(TokenError::UnknownKey(key.clone()));
    }
    let (name, role, secret) = (text("name")?.to_owned(), text("role")?, Secret::new(text("secret")?));
    let Ok(role) = role.parse() else { return Err(TokenError::Role(name)) };
    if secret.reveal().len() < MIN_SECRET_LEN {
        return Err(TokenError::Short(name));
    }
    if !secret.reveal().bytes().all(|byte| byte.is_ascii_graphic()) {
        return Err(TokenError::InvalidCharacter(name));
    }
    Ok(Token { name: name.into(), role, hash: blake3::hash(secret.reveal().as_bytes()) })
}
