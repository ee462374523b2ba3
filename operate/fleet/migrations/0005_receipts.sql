-- Calls of planners that carry a request id and were carried out, with their answers: a repeat gets the first one, on any planner. Stored in
-- the transaction that carries the call out; kept for ten minutes, and at most 4096 for each client.
CREATE TABLE receipts (
    client      text NOT NULL,
    request_id  text NOT NULL,
    -- Hash of the request.
    request     bytea NOT NULL CHECK (length(request) = 32),
    answer      bytea NOT NULL CHECK (length(answer) <= 16384),
    noted_at    timestamptz NOT NULL DEFAULT now(),
    PRIMARY KEY (client, request_id)
);
CREATE INDEX receipts_by_age ON receipts (noted_at);
CREATE INDEX receipts_by_client ON receipts (client, noted_at);
