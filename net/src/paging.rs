//! Pagination (AIP-158): a page token is the key of the last item of the previous page.

use crate::status;
use surefoot_proto::reason::Reason;
use tonic::Status;

/// One page of a list.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Page<T> {
    /// Items of the page, in the order of the list.
    pub items: Vec<T>,
    /// Token of the next page; empty if this is the last one.
    pub next_token: String,
}

/// Default and greatest size of a list's pages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PageSize {
    /// Items per page if the client does not set a size.
    pub default: u32,
    /// Most items per page.
    pub max: u32,
}

impl PageSize {
    /// For resources of which a service has few.
    pub const USUAL: Self = Self { default: 100, max: 1000 };

    /// Number of items for a page size of `wanted` in the request; 0 means the default.
    fn items(self, wanted: u32) -> Result<usize, Status> {
        match wanted {
            0 => Ok(self.default as usize),
            wanted if wanted > self.max => {
                let message = format!("page_size is {wanted}, at most {} are allowed", self.max);
                Err(status::too_large("page_size", message))
            }
            wanted => Ok(wanted as usize),
        }
    }
}

/// Returns the page of `all` that follows the item whose `key` is `token`; an empty token means the first page.
pub fn page<T>(
    all: impl IntoIterator<Item = T>,
    key: impl Fn(&T) -> String,
    size: PageSize,
    wanted: u32,
    token: &str,
) -> Result<Page<T>, Status> {
    let count = size.items(wanted)?;
    let mut rest = all.into_iter();
    if !token.is_empty() && !rest.by_ref().any(|item| key(&item) == token) {
        let message = format!("page_token `{token}` is not of this list, or its item was removed: start again");
        return Err(status::failure(Reason::InvalidPageToken, message));
    }
    let items: Vec<T> = rest.by_ref().take(count).collect();
    let next_token = match rest.next() {
        Some(_) => items.last().map(key).unwrap_or_default(),
        None => String::new(),
    };
    Ok(Page { items, next_token })
}

/// Returns a page of a list in ascending order of ids. The item of the token may have been removed.
pub fn page_by_id<T>(
    all: impl IntoIterator<Item = T>,
    id: impl Fn(&T) -> u64,
    size: PageSize,
    wanted: u32,
    token: &str,
) -> Result<Page<T>, Status> {
    let after = match token {
        "" => None,
        token => Some(token.parse::<u64>().map_err(|_| {
            status::failure(Reason::InvalidPageToken, format!("page_token `{token}` is not of this list: start again"))
        })?),
    };
    let rest = all.into_iter().filter(|item| after.is_none_or(|after| id(item) > after));
    page(rest, |item| id(item).to_string(), size, wanted, "")
}
