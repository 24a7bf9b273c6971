// Returns the share that a logit stands for; the limit keeps exp from overflowing.
float share_of(float logit) { return 1.0 / (1.0 + exp(-clamp(logit, -80.0, 80.0))); }
