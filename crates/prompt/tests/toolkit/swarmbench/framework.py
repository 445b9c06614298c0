class SwarmFramework:
    def run_level(self):
        sys_prompt = "You belong to a group {of agents}."
        return {"sys_prompt": sys_prompt}
