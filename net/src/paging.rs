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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_follow_one_another_without_gaps_or_repeats() {
        let size = PageSize { default: 3, max: 5 };
        let mut token = String::new();
        let mut seen = Vec::new();
        let mut pages = 0;
        loop {
            let page = page_by_id(1..=7u64, |id| *id, size, 0, &token).unwrap();
            seen.extend(page.items);
            pages += 1;
            token = page.next_token;
            if token.is_empty() {
                break;
            }
        }
        assert_eq!((seen, pages), ((1..=7).collect::<Vec<u64>>(), 3));
        assert_eq!(page_by_id(1..=5u64, |id| *id, size, 5, "").unwrap().next_token, "", "a full last page is the last");
        // The item of the token may be gone: ids only grow.
        assert_eq!(page_by_id([1u64, 4, 5], |id| *id, size, 0, "3").unwrap().items, [4, 5]);
        let names = ["c", "a", "b"].map(str::to_owned);
        assert_eq!(page(names.clone(), String::clone, size, 1, "a").unwrap().items, ["b"]);
        assert_eq!(Reason::of(&page(names, String::clone, size, 1, "z").unwrap_err()), Some(Reason::InvalidPageToken));
        assert_eq!(Reason::of(&page_by_id([1u64], |id| *id, size, 6, "").unwrap_err()), Some(Reason::TooLarge));
        assert!(page_by_id([1u64], |id| *id, size, 0, "x").is_err());
    }
}
