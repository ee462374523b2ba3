//! The deadline of a call: the one that its client sets, within limits.

use super::limits::Limits;
use crate::status;
use axum::http::HeaderMap;
use std::time::Duration;
use surefoot_proto::reason::Reason;
use tonic::Status;

/// The deadline of a call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Deadline {
    /// Time from the request to the answer.
    pub after: Duration,
    /// Its origin.
    by: By,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum By {
    Default,
    Client,
    Limit,
}

impl Deadline {
    /// The deadline of a call whose client sets `own`.
    pub fn new(own: Option<Duration>, limits: &Limits) -> Self {
        match own {
            None => Self { after: limits.default_deadline, by: By::Default },
            Some(own) if own > limits.max_deadline => Self { after: limits.max_deadline, by: By::Limit },
            Some(own) => Self { after: own, by: By::Client },
        }
    }

    /// The status of a call that was not answered in time.
    pub fn missed(self) -> Status {
        let seconds = self.after.as_secs_f64();
        let message = match self.by {
            By::Default => format!(
                "no answer within {seconds} s, the default deadline (--default-deadline): set a longer one for the call"
            ),
            By::Client => format!("no answer within {seconds} s, the deadline of the call"),
            By::Limit => format!("no answer within {seconds} s, the longest deadline of a call (--max-deadline)"),
        };
        status::failure(Reason::DeadlineExceeded, message)
    }
}

/// The deadline in the header of Connect.
pub(super) fn of_connect(headers: &HeaderMap) -> Result<Option<Duration>, Status> {
    let Some(limit) = headers.get("connect-timeout-ms") else { return Ok(None) };
    let milliseconds = limit.to_str().ok().and_then(|text| text.parse::<u64>().ok());
    let refusal = || status::failure(Reason::MalformedRequest, "connect-timeout-ms is not a number of milliseconds");
    milliseconds.map(Duration::from_millis).ok_or_else(refusal).map(Some)
}

/// The deadline in the header of gRPC; `None` if there is none or it is malformed.
pub(super) fn of_grpc(headers: &HeaderMap) -> Option<Duration> {
    let text = headers.get("grpc-timeout")?.to_str().ok()?;
    let (number, unit) = text.split_at_checked(text.len().checked_sub(1)?)?;
    // At most eight digits, by the specification.
    let number =
        Some(number).filter(|it| (1..=8).contains(&it.len()) && it.bytes().all(|byte| byte.is_ascii_digit()))?;
    let number: u64 = number.parse().ok()?;
    match unit {
        "H" => Some(Duration::from_secs(number * 3600)),
        "M" => Some(Duration::from_secs(number * 60)),
        "S" => Some(Duration::from_secs(number)),
        "m" => Some(Duration::from_millis(number)),
        "u" => Some(Duration::from_micros(number)),
        "n" => Some(Duration::from_nanos(number)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    #[test]
    fn the_clients_deadline_counts_up_to_the_longest_one() {
        let limits = Limits { max_deadline: Duration::from_secs(60), ..Limits::default() };
        let after = |text: &'static str| {
            let headers = HeaderMap::from_iter([("grpc-timeout".parse().unwrap(), HeaderValue::from_static(text))]);
            Deadline::new(of_grpc(&headers), &limits).after
        };
        assert_eq!(after("2S"), Duration::from_secs(2));
        assert_eq!(after("1500m"), Duration::from_millis(1500));
        assert_eq!(after("59999999u"), Duration::from_micros(59_999_999));
        assert_eq!(after("7n"), Duration::from_nanos(7));
        for long in ["1H", "2M", "99999999H", "99999999S"] {
            assert_eq!(after(long), limits.max_deadline);
        }
        for malformed in ["", "S", "5", "-5S", "5x", "123456789S", "5 S", "\u{e4}"] {
            let headers = HeaderMap::from_iter([("grpc-timeout".parse().unwrap(), malformed.parse().unwrap())]);
            assert_eq!(Deadline::new(of_grpc(&headers), &limits).after, limits.default_deadline, "{malformed}");
        }
    }
}
