-- The greatest id that a world was given. Ids are never used again.
CREATE TABLE world_ids (last bigint NOT NULL);
INSERT INTO world_ids VALUES (0);

-- Worlds, as they were saved last. A world belongs to the member that took it over last, and goes on elsewhere when that member's lease is
-- over. Each of its tenures has a token; who writes names it.
CREATE TABLE worlds (
    id        bigint PRIMARY KEY,
    owner     bigint NOT NULL REFERENCES members,
    token     bigint NOT NULL,
    -- Name of the blob with the save.
    blob      bytea NOT NULL CHECK (length(blob) = 32),
    -- Sequence number of the world's latest event in it.
    through   bigint NOT NULL,
    saved_at  timestamptz NOT NULL
);
CREATE INDEX worlds_by_owner ON worlds (owner);

-- What happened after the save, in batches: each has the events up to its number.
CREATE TABLE world_events (
    world    bigint NOT NULL REFERENCES worlds ON DELETE CASCADE,
    through  bigint NOT NULL,
    events   bytea NOT NULL,
    PRIMARY KEY (world, through)
);
