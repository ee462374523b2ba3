-- Processes of the fleet. One that has not renewed its lease is taken for dead: others take over what it held, and its writes are
-- refused, since whoever writes checks its fencing token and its lease in the transaction that writes.
CREATE TABLE members (
    id          bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    kind        text NOT NULL CHECK (kind IN ('server', 'planner')),
    -- URI at which clients and other members reach it.
    address     text NOT NULL,
    expires_at  timestamptz NOT NULL
);

-- Fencing tokens of all claims: each is greater than all before it.
CREATE SEQUENCE tokens;
