-- Who waits for a build, as its planner knows; and who has withdrawn by way of another planner, in this order.
ALTER TABLE operations
    ADD COLUMN requesters text[] NOT NULL DEFAULT '{}',
    ADD COLUMN withdrawn text[] NOT NULL DEFAULT '{}';
