"""The paper's tables, figures and claims, measured again."""
